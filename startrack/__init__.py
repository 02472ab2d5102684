"""startrack designs star trackers and other opto-electronic space cameras before they are built."""

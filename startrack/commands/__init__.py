"""What each command does, one file a command; `terminal` holds how they speak."""

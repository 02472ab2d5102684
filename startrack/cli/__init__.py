"""The command `startrack`: one file per command; each declares its options.

main        The list of commands, and the exit status of their errors.
options     Shared parts of commands: exit status, wrong use, readers of numbers, tables of options,
            and late imports.
stopping    A signal or an error -> the end of a command, and its message.
files       A path or a name on the command line -> its file, and which kind of file it is.
terminal    Designs and other inputs, and outputs: results on standard output, messages on standard
            error.
campaign    Shared parts of commands on campaigns: the design, the workers, the runner of trials.
problems    The commands on campaigns for problems other than star trackers: an Earth camera.
units       Units in `startrack budget` and `montecarlo`: classes of error, levels, yields.
not_known   Figures over the unknown values of a design: intervals, and fractions of draws that meet
            limits.
beside      At the first run, a second process compiles kernels while the command works.

Of one frame or lens: simulate, psf, lens, detect, solve, calibrate. Of many trials: budget,
predict, montecarlo, merge, combine, compare, compare_flight, report, requirements, verify. In time:
sequence, serve, mission, export. Of many designs: sweep, solve_for, optimize, page, sample, pareto,
what_matters. Of Earth cameras: earth. Others: init, keys, warm, bench. `main.COMMANDS` describes
each.
"""

from startrack.cli.main import main

__all__ = ["main"]

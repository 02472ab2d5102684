"""The command `startrack`: one file per command, which declares its own options.

main                The list of commands, and the exit status of their errors.
options             What commands share: exit status, wrong use, readers of numbers, tables of
                    options, and imports that wait until a command runs.
stopping            A signal or an error -> what ends a command, and the words that tell it.
terminal            Inputs by name, and outputs: results on standard output, messages on standard
                    error.
campaign            What the commands on campaigns share: the design, the workers, the runner of
                    trials, and the folder.
beside              At the first run, another process compiles while this one works.
bench               `startrack bench`: the CPU time and the error of every stage, on this machine.
budget              `startrack budget`: the error of a design cause by cause.
calibrate           `startrack calibrate`: the camera model of images of stars, or of a table.
combine             `startrack combine`: one error from campaigns of different fidelity.
compare             `startrack compare`: two designs or campaigns side by side.
compare_flight      `startrack compare-flight`: a design beside images that its tracker sent down.
detect              `startrack detect`: the stars of images.
earth               `startrack earth`: geometry and images of Earth cameras over terrain.
init                `startrack init`: a design file to begin with.
export              `startrack export`: a design as data and code for other programs.
keys                `startrack keys`: what a design file may hold.
lens                `startrack lens`: tables of lenses from prescriptions.
merge               `startrack merge`: parts of a campaign from several machines, as one.
mission             `startrack mission`: heads of a spacecraft over orbit and attitude law.
montecarlo          `startrack montecarlo`: the error of one design over many trials.
optimize            `startrack optimize`: a better design, found by search and checked by trials.
pareto              `startrack pareto`: designs that no other beats in both of two goals.
psf                 `startrack psf`: how the optics of a design blur a star.
report              `startrack report`: a campaign as one self-contained HTML page.
requirements        `startrack requirements`: margins of a design to its requirements; figures of
                    Earth cameras.
sample              `startrack sample`: the tolerance of each parameter of a design.
sensitivity         `startrack sensitivity`: which parameters the error of a design depends on.
sequence            `startrack sequence`: a tracker in time.
simulate            `startrack simulate`: render one frame of a design.
solve               `startrack solve`: the attitude of images.
units               Units in `startrack budget` and `montecarlo`: classes of error, levels, yields.
verify              `startrack verify`: a verdict on each requirement of a design.
warm                `startrack warm`: compile the kernels before they are needed.
"""

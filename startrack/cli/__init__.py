"""The command `startrack`: one file per command, which declares its own options.

exits               How a command ends: its exit status, and the error that asks for another call.
main                the list of commands, and how their errors end
options             what commands share: readers of numbers, common options
compiling           Kernels that numba compiles enter; a word to the person who waits for them
                    leaves.
terminal            How the commands speak: results on standard output, messages and progress on
                    standard error.
study               What the commands on campaigns share: the design that is asked, its bench, and
                    its folder.
bench               `startrack bench`: the CPU time and the error of every stage, on this machine.
budget              `startrack budget`: what the error of a design is made of, cause by cause.
calibrate           `startrack calibrate`: the camera behind images of stars.
combine             `startrack combine`: one error from campaigns of different fidelity.
detect              `startrack detect`: the stars of images.
earth               `startrack earth`: a camera in flight over terrain.
earth_requirements  Earth cameras for `startrack requirements`: figures of a design, first
                    parameters for goals.
montecarlo          `startrack montecarlo`: many trials of one design.
optimize            `startrack optimize`: a better design.
pareto              `startrack pareto`: what one goal costs in terms of another.
psf                 `startrack psf`: how the optics of a design blur a star.
report              `startrack report`: a campaign as one page to read and to send.
requirements        `startrack requirements`: what a design must meet, how far it does; Earth
                    cameras, too.
sample              `startrack sample`: how far each parameter may stray from a design.
sensitivity         `startrack sensitivity`: which parameters the error of a design depends on.
sequence            `startrack sequence`: a tracker followed in time.
simulate            `startrack simulate`: render one frame of a design.
solve               `startrack solve`: the attitude of images.
"""

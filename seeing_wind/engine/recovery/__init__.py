"""From observed motion to the force field that caused it.

    stage.py        the stage: a force and its field         journal.py    intermediate results that survive a crash
    recover.py      from body, targets and settings to a force
    clip.py         the whole clip, block by block           blocks.py     the division into blocks
    kept.py         what a block contributes to the clip     cost.py       an estimate of the solve's duration
    diagnostics/    what the user should know about a solution
    solve/          Gauss-Newton through the simulator       resimulate/   a recovered field on other bodies
    prior/          what is assumed about a force beforehand
    targets/        what was observed, as residuals          wind/         the force as a wind, and bodies in it
                                                             paper/        the paper's own schedule for the same problem

Nothing is imported here: `observe` keeps a journal, too, and should not wait for the solver to load.
"""

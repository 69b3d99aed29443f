"""From observed motion to the force field that made it.

    stage.py        the stage: a force and its field         journal.py    what a crash does not cost
    recover.py      body, targets and settings to a force
    clip.py         the whole clip, block by block         blocks.py     how it is cut
    cost.py         how long it takes, told beforehand       diagnostics/  what the user should know about a solution
    solve/          Gauss-Newton through the simulator       resimulate/   a recovered field on other bodies
    prior/          what is believed of a force beforehand
    targets/        what was observed, as residuals          wind/         the force as a wind, and bodies in it
                                                             paper/        the paper's own schedule for the same problem

Nothing is imported here: `observe` keeps a journal, too, and shall not wait for the solver.
"""

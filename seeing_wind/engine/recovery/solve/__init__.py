"""Gauss-Newton through the simulator, coarse to fine.

    block.py         one block of the clip, from a rough start to the final solve
    first_field.py   the first field of a block, found segment by segment
    onward.py        a start from the block before, instead
    warm_start.py    receding-horizon control, which begins each segment
    problem.py       the least-squares problem of one solve         gauss_newton.py  the dense solve
    forward.py       the forward model: from unknowns to trajectories and Jacobians
    stiffness.py     Young's modulus and the clamp as unknowns      section.py    the distribution of stiffness over a section
    known_body.py    both, from another clip of the same body
    solver.py        a block's data, simulations and solves         constants.py  how far and how finely the solve goes
"""

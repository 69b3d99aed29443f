"""Gauss-Newton through the simulator, coarse to fine.

    block.py        one block of the clip, from a rough start to the final solve
    first_field.py   a first field for it, segment by segment
    onward.py        or the field of the block before, where the body is held
    warm_start.py    receding-horizon control, where a segment begins
    problem.py       what one solve minimises         gauss_newton.py  the dense solve
    forward.py       unknowns in, trajectories and Jacobians out
    stiffness.py     Young's modulus and the clamp as unknowns      section.py  how stiffness is spread over a section
    known_body.py    both, from another clip of the same body
    solver.py        one block: simulations and solves of it        constants.py  how far and how finely it goes
"""

"""The paper's own scheme (arXiv 2512.00762, section 3.4), for comparison: `--schedule paper`, `--objective`, `--refine`.

    schedule.py         frame by frame, gradient descent through the simulator
    field.py            the three representations as parameters of that descent
    start.py            the initial velocity, and the size of force to expect
    losses.py           the tracking loss, and what all losses share
    image_loss.py       the photometric loss (Table 3)     flow_depth_loss.py  the dense scene-flow loss (Table 3)
    refinement.py       refines a stored field through the simulator, all frames at once
"""

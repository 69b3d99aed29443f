"""The paper's own scheme (arXiv 2512.00762, section 3.4), for comparison: `--schedule paper`, `--objective`, `--refine`.

    schedule.py         frame by frame, gradient descent through the simulator
    field.py            the three representations as parameters of that descent
    start.py            where it starts from
    losses.py           the tracking loss, and what all losses share
    image_loss.py       the photometric loss (Table 3)     flow_depth_loss.py  the dense scene-flow loss (Table 3)
    refinement.py       a stored field refined through the simulator, all frames at once
"""

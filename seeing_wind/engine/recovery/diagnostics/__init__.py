"""What the user should know about a solution.

    posterior.py  the standard deviation of the force    remarks.py  notes on what a clip does not show or contradicts
    missed.py     whether the residual is so large that the force is of no use
"""

"""What the user should know about a solution.

    posterior.py  the standard deviation of the force    remarks.py  notes on what a clip does not show, or shows to be wrong
    missed.py     whether so much is missed that the force is of no use
"""

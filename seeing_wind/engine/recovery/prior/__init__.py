"""What is believed of a force before the clip is seen, and how the clip changes it.

    kernel.py    the Gaussian process over space and time        stretch.py    a penalty on forces that only stretch a body
    basis.py     the functions in which the force is written     evidence.py   hyperparameters by type-II maximum likelihood
    learning.py  a block's prior, and what is learnt from it     constants.py  the prior's numbers
"""

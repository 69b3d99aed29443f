"""What is believed of a force before the clip is seen, and how the clip changes it.

    kernel.py    the Gaussian process over space and time     stretch.py   forces that only stretch a body
    basis.py     the functions in which the solve writes it   evidence.py  its hyperparameters, by type-II maximum likelihood
    learning.py  a block's beliefs, before and after                 constants.py  its numbers
"""

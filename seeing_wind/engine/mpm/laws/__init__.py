"""Constitutive laws: deformation in, stress out, with their derivatives. All are compiled functions.

    constitutive.py  neo-Hookean and fixed corotated        plasticity.py  von Mises and viscoplastic flow
    viscous.py       stress from the strain rate: damping
    eigen.py         symmetric 3x3 matrices in closed form  strain.py      their logarithm and exponential
"""

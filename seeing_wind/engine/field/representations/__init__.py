"""The representations in which a field can be stored.

    triplane.py  the paper's causal tri-plane                  planes.py   feature planes with B-spline interpolation
    kplanes.py   K-Planes, for comparison (Table 2)            neural.py   the base of the learned representations
    point.py     one vector per particle, for comparison       lattice.py  values on a lattice, for a field without its take
"""

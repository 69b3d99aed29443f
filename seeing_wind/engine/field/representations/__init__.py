"""What a recovered field can be stored as.

    triplane.py  the paper's causal tri-plane                  planes.py  feature planes with B-spline interpolation
    kplanes.py   K-Planes, for comparison (Table 2)            neural.py  what learned representations share
    point.py     one vector per particle, for comparison       lattice.py  values on a lattice, of a field that came without its take
"""

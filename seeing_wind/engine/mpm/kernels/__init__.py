"""The substep as compiled kernels. Everything that runs substeps is built from the functions in `substep.py`.

    substep.py, packed.py             p2g, nodes, g2p of one particle or node; the layout of particles, and their transfer
    parallel.py, parallel_forward.py, parallel_adjoint.py  one body on all cores (crew.py), forwards and backwards
    copies_forward.py                 many copies of a body, each on one core; or one body with every substep kept
    linearise.py, carry.py            many small changes of such a body, to first order
    pack.py, native.py                conversion between NumPy's arrays and that layout; arrays aligned for SIMD vectors
"""

"""The substep as compiled kernels. All that runs it is made of the functions in `substep.py`.

    substep.py, packed.py             p2g, nodes, g2p of one particle or node; particles in rows, and their transfer
    parallel.py, parallel_forward.py, parallel_adjoint.py  one body on all cores (crew.py), forwards and backwards
    copies_forward.py                 many copies of a body, each on one core; or one with all its substeps kept
    linearise.py, carry.py            many small changes of such a body, to first order
    pack.py, native.py                between NumPy's arrays and rows; arrays for vectors of the processor
"""

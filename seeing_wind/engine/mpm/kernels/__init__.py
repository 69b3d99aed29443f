"""The substep as compiled kernels, in three forms.

    transfer.py, substep.py           many copies of one small body, float64
    packed.py, pack.py, parallel.py   one large body on all cores (crew.py),
    parallel_forward.py, parallel_adjoint.py  forwards and backwards
    tangent_kernels.py                many small changes of one simulation, to first order
    native.py                         arrays for vectors of the processor
"""

"""The substep as Taichi kernels, in three forms, and how they are launched.

    transfer.py, substep.py           many copies of one small body, float64
    packed.py, pack.py, parallel.py   one large body on all cores (crew.py),
    parallel_forward.py, parallel_adjoint.py  forwards and backwards
    tangent_kernels.py                many small changes of one simulation, to first order
    launch.py, native.py              cheap launches and vector types
"""

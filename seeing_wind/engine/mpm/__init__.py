"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; the compiler stays inside, and torch is used in `autograd` only.

    model.py      what stays the same        model_for.py  a model for bodies and materials     state.py     what changes
    rollout.py    frames of one body         batch.py      frames of many copies of a body      copies.py    the copies' states
    tangent.py    many changes, to first order             autograd.py  the interface to torch  damping.py   damping and substeps
    courant.py    the substeps that stability needs        checks.py    what is refused         failure.py   why a run stopped
    body/  one body on all cores
    laws/  stress from deformation     lattice/  the grid and its boundary     kernels/  the substep     compiler/  Quadrants or Taichi
    shell/ thin sheets, which have no grid: a solver of their own
"""

"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; the compiler stays inside, torch above it in `autograd` only.

    model.py      what stays the same        model_for.py  chosen from bodies and materials     state.py  what changes
    rollout.py    frames of one body         batch.py      frames of many copies of it          copies.py    their states
    tangent.py    many changes to first order              autograd.py    for torch             damping.py   what substeps carry
    courant.py    how many substeps waves need             checks.py      what is refused       failure.py   what stopped a run
    body/  one body on all cores
    laws/  stress from deformation     lattice/  the grid and its boundary     kernels/  the substep     compiler/  Quadrants or Taichi
    shell/ thin sheets, which have no grid: a solver of their own
"""

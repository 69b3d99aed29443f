"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; Taichi stays inside, torch above it in `autograd` only."""

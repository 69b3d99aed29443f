"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; Taichi stays inside, torch above it in `autograd` only."""

import os

# Taichi prints its version on import, to stdout, where the worker's messages go, and asks a server for a newer one when it starts.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")

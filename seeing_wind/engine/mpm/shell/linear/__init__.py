"""The linear equations of a shell.

    system.py      the matrix of a Newton iteration, and conjugate gradients
    cholesky.py    factors of nearly the same matrix, and solves with them
    dissection.py  the order in which they eliminate vertices          fronts.py         their dense parts: what depends on the pattern
    front_kernels.py, solve_kernels.py  the parts' arithmetic          system_kernels.py  the matrix's blocks and products
"""

from .cholesky import Factors
from .system import Matrix, System, Unfinished

__all__ = ["Factors", "Matrix", "System", "Unfinished"]

"""The linear equations of a shell.

    system.py      the matrix of a Newton iteration, and conjugate gradients
    cholesky.py    factors of nearly the same matrix, and solves with them
    dissection.py  the order of elimination          fronts.py  dense parts ("fronts") of the factors: what depends on the pattern
    front_kernels.py, solve_kernels.py  arithmetic of the fronts          system_kernels.py  the matrix's blocks and products
"""

from .cholesky import Factors
from .system import Matrix, System, Unfinished

__all__ = ["Factors", "Matrix", "System", "Unfinished"]

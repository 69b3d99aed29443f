"""From observed motion to the force field that made it: see `recover`; `recover_by_descent` is the paper's own scheme, `refine` goes on
from a stored field."""

from ..paper.refinement import refine
from ..paper.schedule import recover_by_descent
from .recover import recover

__all__ = ["recover", "recover_by_descent", "refine"]

"""From observed motion to the force field that made it: see `recover`."""

from .recover import recover

__all__ = ["recover"]

"""The one door to the compiler of the kernels: Quadrants, or Taichi, from which Quadrants comes. Nobody else imports either.

    choice    which of the two, its module as `ti`, and the precision that kernels are traced in
    launch    the same kernel launched thousands of times

Kernels and laws take `ti` from here. What the two packages keep private (`_runtime`, and the calls in `launch`) stays in this room.
"""

from .choice import DEFAULT, NAME, NAMES, default_real, set_default_real, ti

__all__ = ["DEFAULT", "NAME", "NAMES", "default_real", "set_default_real", "ti"]

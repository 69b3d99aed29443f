"""The one door to the compiler of the kernels: Quadrants, or Taichi, from which Quadrants comes. Nobody else imports either.

    choice.py    which of the two, its module as `ti`, and the precision that kernels are traced in
    settings.py  what either is told when it starts       device.py  its start: once, on first use, never at import
    launch.py    the same kernel launched many times      precision.py  single and double precision from one source
    tracing.py   kernels declared and traced in half the time

Kernels and laws take `ti` from here. What the two packages keep private (`_runtime`, and the calls in `launch`) stays in this room.
"""

from .choice import DEFAULT, NAME, NAMES, default_real, set_default_real, ti

__all__ = ["DEFAULT", "NAME", "NAMES", "default_real", "set_default_real", "ti"]

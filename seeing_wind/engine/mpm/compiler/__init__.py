"""The only place that imports the compiler of the kernels: Taichi, or Quadrants, which is derived from it.

    choice.py    which of the two, its module as `ti`, and the precision in which kernels are traced
    settings.py  settings for the kernels traced in a block     device.py     the compiler's start: once, on first use, never at import
    launch.py    launching one kernel many times                precision.py  single and double precision from one source
    tracing.py   declaring and tracing kernels in half the time

Kernels and laws import `ti` from here. Private parts of the packages (`_runtime`, and the calls in `launch`) are used in this room only.
"""

from .choice import DEFAULT, NAME, NAMES, default_real, set_default_real, ti

__all__ = ["DEFAULT", "NAME", "NAMES", "default_real", "set_default_real", "ti"]

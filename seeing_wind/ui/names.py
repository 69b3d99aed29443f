"""What the panels read of the field's objects, in a file without NumPy: they are drawn before anything is made."""

from __future__ import annotations

ARROWS_MATERIAL = "Seeing Wind Arrows"


def in_figures(value: float) -> str:
    """A strength with three figures, without a power of ten where a person would write none."""
    return f"{float(f'{value:.3g}'):.0f}" if 100.0 <= value < 1e6 else f"{value:.3g}"

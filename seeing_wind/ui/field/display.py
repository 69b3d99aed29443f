"""Names and texts by which the field's objects are known and read. Without NumPy: panels are drawn before anything is made."""

from __future__ import annotations

ARROWS_MATERIAL = "Seeing Wind Arrows"

SAMPLES_MARK, LEGEND_MARK = "seeing_wind_samples", "seeing_wind_legend"
"""Custom properties of the object with the field's values, and of the arrows' legend."""


def in_figures(value: float) -> str:
    """A strength with three figures, without a power of ten where a person would write none."""
    return f"{float(f'{value:.3g}'):.0f}" if 100.0 <= value < 1e6 else f"{value:.3g}"

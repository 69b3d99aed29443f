"""The recovered field where bodies are, also where nobody saw anything move."""

from __future__ import annotations

import numpy as np

from ...field.force_field import ForceField


def continued(field: ForceField, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Force density (M, 3) [N/m³] and its gradient (M, 3, 3) [N/m⁴] at points (M, 3) [m]; beyond the box those of its nearest place."""
    nearest = np.clip(points, field.box[0], field.box[1])
    force, _ = field.sample(nearest, frame)
    return force, field.gradient(nearest, frame) * (nearest == points)[:, None, :]


def outside_note(x: np.ndarray, field: ForceField) -> list[str]:
    """A note if more than a tenth of a body was outside the field's box at some time. x (T+1, N, 3) [m]."""
    outside = ((x < field.box[0]) | (x > field.box[1])).any(axis=2).mean(axis=1)
    if outside.max() <= 0.1:
        return []
    first = int(np.argmax(outside > 0.1))
    share = 100 * outside.max()
    where = f"up to {share:.0f} % of it lies outside the field's box, first in frame {first}"
    return [f"{where}; the {field.kind} there is that of the box's edge"]

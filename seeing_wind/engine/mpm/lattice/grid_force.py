"""Force prescribed at the nodes of the lattice: an acceleration that acts on all matter at a node, whatever particles it came from.

Added to the nodes' velocities between momentum / mass and the boundary conditions (the other way in, a force on particles before p2g, is
`rollout`'s `acceleration`). A uniform one is gravity; one that varies over a cell acts on the particles as `transfer`'s splines see it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...errors import UsageError
from ..model import GridForce, Model

_MOST_PUSHED = 3_000_000
"""Nodes of the box of a force (72 MB for each frame)."""


def with_grid_force(model: Model, low: np.ndarray, high: np.ndarray, field: Callable[[np.ndarray], np.ndarray]) -> Model:
    """The model with a force at all nodes of the lattice between the corners low and high (3,) [m].

    Args:
        field: from places (P, 3) [m] to accelerations (P, 3), or (T, P, 3) with one for each frame [m/s²].

    Raises:
        UsageError: the box is not finite, has no node or too many, or the field's shape is wrong or a value not finite.
    """
    low, high = np.asarray(low, float), np.asarray(high, float)
    if low.shape != (3,) or high.shape != (3,) or not (np.isfinite(low) & np.isfinite(high)).all():
        raise UsageError(f"The box of the grid force reaches from {low} to {high}.", "Give two corners of three finite numbers.")
    axes = np.eye(3) if model.axes is None else model.axes
    corners = np.array(list(itertools.product(*zip(low, high)))) @ axes
    begin = np.ceil((corners.min(axis=0) - model.offset) / model.dx)
    count = np.floor((corners.max(axis=0) - model.offset) / model.dx) - begin + 1.0
    if (count < 1.0).any() or (low > high).any():
        raise UsageError("No node of the grid lies in the box of the grid force.", f"Make it larger than a cell, {model.dx:.3g} m.")
    if np.prod(count) > _MOST_PUSHED or (np.abs(begin) + count > 2.0**30).any():
        raise UsageError(
            f"The box of the grid force has {np.prod(count):.3g} nodes, more than {_MOST_PUSHED:.0e}.", "Make it no larger than the motion."
        )
    first, count = begin.astype(np.int32), count.astype(np.int64)
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)
    places = (model.offset + model.dx * (first + nodes)) @ axes.T
    found = np.asarray(field(places), dtype=np.float64)
    if found.ndim not in (2, 3) or found.shape[-2:] != nodes.shape or not len(found):
        raise UsageError(f"The grid force has shape {found.shape}.", f"It must be ({len(nodes)}, 3), or (T, {len(nodes)}, 3).")
    if not np.isfinite(found).all():
        place = ", ".join(f"{c:.3g}" for c in places[np.argwhere(~np.isfinite(found))[0, -2]])
        raise UsageError(f"The grid force at ({place}) m is not finite.", "Check the field that gives it.")
    inside = ((places >= low - 1e-9 * model.dx) & (places <= high + 1e-9 * model.dx)).all(axis=1)
    found = np.where(inside[:, None], found, 0.0) @ axes
    return replace(model, grid_force=GridForce(first, found.reshape(*found.shape[:-2], *count, 3)))

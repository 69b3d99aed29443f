"""Folds: how many a draped square has does not depend on the mesh, once it is fine enough."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import find_peaks

from seeing_wind.engine.materials import Sheet
from seeing_wind.engine.mpm.shell import advance, at_rest, shell_of

SIDE, TABLE, RING = 0.4, 0.2, 0.18
"""m: the cloth's side, the table's, and how far from the middle of the cloth folds are counted."""
HEAVY = Sheet(0.36, 8e-4, 2e4, 9e-5, loss_factor=1.5, poisson_ratio=0.3)
"""Four times as stiff as denim, with the damping that lets it come to rest soon."""


def ring(x, faces, moved):
    """Where the points of a circle on the flat sheet, one every degree, have gone (360, 3)."""
    turns = np.radians(np.arange(360.0))
    at = RING * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    corners = x[faces, :2]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    share = np.einsum("fij,pfj->pfi", np.linalg.inv(edges), at[:, None] - corners[:, 0])
    weights = np.concatenate([1.0 - share.sum(axis=2, keepdims=True), share], axis=2)
    face = weights.min(axis=2).argmax(axis=1)
    return np.einsum("pc,pci->pi", weights[np.arange(360), face], moved[faces[face]])


def folds(x, faces, moved):
    """Degrees at which the sheet stands out from the middle, by 2 mm more than on both sides."""
    out = np.linalg.norm(ring(x, faces, moved)[:, :2], axis=1)
    peaks, _ = find_peaks(np.tile(out, 3), prominence=0.05 * np.ptp(out) + 0.002)
    return peaks[(peaks >= 360) & (peaks < 720)] - 360


@pytest.mark.parametrize(("kind", "columns"), [
    ("grid", 16), ("irregular", 32),
    *(pytest.param(*one, marks=pytest.mark.slow) for one in (("grid", 24), ("grid", 32), ("irregular", 24))),
])  # fmt: skip
def test_a_square_on_a_square_table_has_a_fold_at_each_corner(make, kind, columns):
    x, faces = make[kind](SIDE, SIDE, columns, columns)
    x = x - [0.5 * SIDE, 0.5 * SIDE, 0.0]
    shell = shell_of(x, faces, HEAVY, pinned=np.abs(x[:, :2]).max(axis=1) <= 0.5 * TABLE + 1e-9)
    state, gravity = at_rest(shell), np.array([0.0, 0.0, -9.81])
    for _ in range(70):
        state, _ = advance(shell, state, dt=0.02, gravity=gravity)
    assert np.abs(state.v).max() < 0.05
    np.testing.assert_allclose(folds(x, faces, state.x), [45, 135, 225, 315], atol=15)

"""A field as its values on a lattice."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import TakeError
from seeing_wind.engine.field import load_field
from seeing_wind.engine.field.representations.lattice import ForceFieldLattice

BOX = np.array([[-1.0, 0.0, 2.0], [1.0, 0.5, 3.0]])
A = np.array([[1.0, 2.0, 0.0], [0.0, -1.0, 3.0], [0.5, 0.0, 1.0]])


def linear(frames=5, rows=(0, 1, 0, 1, 1)) -> ForceFieldLattice:
    """f = A x in the rows 0, twice that in the rows 1."""
    axes = [np.linspace(BOX[0, k], BOX[1, k], count) for k, count in enumerate((4, 2, 3))]
    values = np.stack(np.meshgrid(*axes, indexing="ij"), -1) @ A.T
    return ForceFieldLattice(BOX, 24.0, frames, np.stack([values, 2.0 * values]), np.array(rows))


def test_it_is_linear_between_its_nodes_and_frames_choose_their_rows():
    field, points = linear(), np.random.default_rng(0).uniform(*BOX, (30, 3))
    for frame, factor in enumerate((1.0, 2.0, 1.0, 2.0, 2.0)):
        np.testing.assert_allclose(field.sample(points, frame)[0], factor * points @ A.T, atol=1e-12)
        np.testing.assert_allclose(field.gradient(points, frame), np.broadcast_to(factor * A, (30, 3, 3)), atol=1e-12)


def test_beside_the_box_it_is_that_of_the_nearest_place():
    field, beside = linear(), np.array([[3.0, 0.2, 2.5]])
    np.testing.assert_allclose(field.sample(beside, 0)[0], field.sample(np.array([[1.0, 0.2, 2.5]]), 0)[0])
    np.testing.assert_allclose(field.gradient(beside, 0)[0], A * [0.0, 1.0, 1.0], atol=1e-12)


def test_it_is_saved_and_loaded(tmp_path):
    field = linear()
    field.kind = "wind"
    field.save(tmp_path / "field.safetensors")
    again = load_field(tmp_path / "field.safetensors")
    assert isinstance(again, ForceFieldLattice) and (again.kind, again.frames, again.fps) == ("wind", 5, 24.0)
    np.testing.assert_array_equal(again.force, field.force)


@pytest.mark.parametrize("rows", [(0, 1, 2, 0, 0), (0, -1, 0, 0, 0), (0, 1, 0)])
def test_rows_that_are_not_there_are_refused(tmp_path, rows):
    field = linear()
    field.row = np.array(rows)
    field.save(tmp_path / "field.safetensors")
    with pytest.raises(TakeError, match="not a field that this version can read"):
        load_field(tmp_path / "field.safetensors")

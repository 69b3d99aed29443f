"""Bodies of an edit in a wind: against the closed form of a plate that is blown along."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.recovery.resimulate import simulate_bodies
from seeing_wind.engine.settings import BodyEdit, Edit
from tests.engine.fields import UniformField
from tests.engine.recovery.wind.blown_plate import AREAL_DENSITY, FPS, FRAMES, SPEED, travelled

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 3.0]])
SIZE = 0.2


@pytest.fixture(scope="module")
def sheet(tmp_path_factory) -> Path:
    """An open square across Z, vertices 2 cm apart."""
    folder, n = tmp_path_factory.mktemp("sheet"), 11
    axis = np.linspace(-0.5 * SIZE, 0.5 * SIZE, n)
    vertices = np.stack(np.meshgrid(axis, axis, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate([np.stack([corner, corner + n, corner + n + 1], 1), np.stack([corner, corner + n + 1, corner + 1], 1)])
    np.savez(folder / "sheet.npz", vertices=vertices, triangles=triangles)
    return folder


def wind(*velocity: float) -> UniformField:
    field = UniformField(BOX, FPS, FRAMES, np.array(velocity))
    field.kind = "wind"
    return field


def blown(folder: Path, field: UniformField, areal_density: float, strength: float = 1.0) -> np.ndarray:
    """Middle of the sheet (T+1, 3) [m]."""
    body = BodyEdit("sheet", "sheet.npz", law="corotated", youngs_modulus=2e4, poisson_ratio=0.3, mass=areal_density * SIZE**2)
    edit = Edit((body,), gravity=(0.0, 0.0, 0.0), field_strength=strength)
    return simulate_bodies(edit, field, None, folder)["sheet"].vertices.mean(axis=1)


@pytest.mark.parametrize("areal_density", [0.05, AREAL_DENSITY, 2.0 * AREAL_DENSITY])
def test_a_sheet_across_the_wind_follows_the_closed_form(sheet, areal_density):
    way = blown(sheet, wind(0.0, 0.0, SPEED), areal_density)[:, 2]
    expected = travelled(np.arange(FRAMES + 1) / FPS, areal_density)
    np.testing.assert_allclose(way[-1], expected[-1], rtol=0.03)
    assert FPS * np.diff(way).max() < SPEED


def test_strength_is_a_factor_on_the_wind(sheet):
    way = blown(sheet, wind(0.0, 0.0, SPEED), AREAL_DENSITY, strength=0.5)[-1, 2]
    assert way == pytest.approx(travelled(FRAMES / FPS, AREAL_DENSITY, 0.5 * SPEED), rel=0.03)


def test_wind_along_a_sheet_rubs_on_it(sheet):
    along = blown(sheet, wind(SPEED, 0.0, 0.0), AREAL_DENSITY)[-1]
    assert along[0] == pytest.approx(travelled(FRAMES / FPS, coefficient=0.05), rel=0.05)
    assert np.abs(along[1:]).max() < 1e-3

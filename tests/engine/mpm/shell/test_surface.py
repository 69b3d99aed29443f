"""What is a sheet and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import MaterialError, UsageError
from seeing_wind.engine.materials import SHEETS, Sheet
from seeing_wind.engine.mpm.shell import shell_of, surface_of


def test_what_is_no_sheet_is_refused_in_words(make):
    x, faces = make["grid"](1.0, 1.0, 2, 2)
    bad = x.copy()
    bad[4, 1] = np.nan
    for mesh, words in (
        ((bad, faces), "Vertex 4 of the sheet is not finite"),
        ((np.vstack([x, [[9.0, 9.0, 9.0]]]), faces), "Vertex 9 of the sheet belongs to no face"),
        ((np.vstack([x, np.full((2, 3), 9.0)]), faces), "2 vertices of the sheet, such as 9, belong to no face"),
        ((x, np.vstack([faces, [[0, 1, 2]]])), "Face 8 of the sheet has no area"),
        ((x, np.vstack([faces, [[0, 1, 2], [3, 4, 5]]])), "2 faces of the sheet, such as 8, have no area"),
        ((np.vstack([x, [[0.5, 0.2, 1.0]]]), np.vstack([faces, [[0, 4, 9]]])), "more than two faces"),
        ((x, faces[:, :2]), "faces of shape"),
        ((x, faces[:0]), "faces of shape"),
    ):
        with pytest.raises(UsageError, match=words):
            surface_of(*mesh)


def test_a_moebius_strip_is_refused():
    turns = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
    across = np.stack([np.cos(turns / 2) * np.cos(turns), np.cos(turns / 2) * np.sin(turns), np.sin(turns / 2)], 1)
    middle = np.stack([3.0 * np.cos(turns), 3.0 * np.sin(turns), np.zeros(24)], 1)
    x = np.concatenate([middle - across, middle + across])
    faces = [[i, i + 1, i + 24] for i in range(23)] + [[i + 1, i + 25, i + 24] for i in range(23)] + [[23, 24, 47], [24, 0, 47]]
    with pytest.raises(UsageError, match="one side"):
        surface_of(x, np.array(faces))


def test_faces_wound_either_way_are_turned_alike(make):
    x, faces = make["irregular"](1.0, 1.0, 4, 4)
    mixed = faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    corners = x[surface_of(x, mixed).faces]
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (np.sign(up) == np.sign(up[0])).all()


def test_a_shell_weighs_what_its_area_weighs(make):
    shell = shell_of(*make["irregular"](0.8, 0.8, 9, 7), SHEETS["cotton"])
    assert shell.mass.sum() == pytest.approx(0.64 * SHEETS["cotton"].areal_density)
    assert (shell.mass > 0.0).all()


@pytest.mark.parametrize("change", [{"areal_density": 0.0}, {"thickness": -1e-3}, {"bending_stiffness": np.nan}, {"loss_factor": 5.0}])
def test_a_sheet_needs_physical_numbers(change):
    with pytest.raises(MaterialError):
        Sheet(**{"areal_density": 0.1, "thickness": 1e-3, "tensile_stiffness": 1e3, "bending_stiffness": 1e-5, **change})

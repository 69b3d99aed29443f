"""Meshes, pins and edits on their way to the engine."""

from __future__ import annotations

import tomllib
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui.edit.resimulate.edit_files import export_mesh, export_pins, write_edit


@pytest.fixture
def cube(scene) -> bpy.types.Object:
    """A cube of 2 units, placed and scaled."""
    bpy.ops.mesh.primitive_cube_add(size=2.0, location=(1.0, 2.0, 3.0), scale=(1.0, 0.5, 2.0))
    return bpy.context.object


def depsgraph() -> bpy.types.Depsgraph:
    return bpy.context.evaluated_depsgraph_get()


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Signed volume [m³] of a closed surface, positive when its normals point outwards."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("mi,mi->m", a, np.cross(b, c)).sum() / 6.0)


def test_mesh_is_written_in_world_metres(cube, tmp_path):
    bpy.context.scene.unit_settings.scale_length = 0.1
    exported = export_mesh(cube, depsgraph(), tmp_path / "bodies" / "cube.npz")
    with np.load(exported, allow_pickle=False) as data:
        vertices, triangles = data["vertices"], data["triangles"]
    assert (vertices.dtype, triangles.dtype) == (np.float64, np.int32)
    assert (len(vertices), len(triangles)) == (8, 12)
    assert np.allclose([vertices.min(axis=0), vertices.max(axis=0)], 0.1 * np.array([[0.0, 1.5, 1.0], [2.0, 2.5, 5.0]]), atol=1e-6)
    assert volume(vertices, triangles) == pytest.approx(8.0e-3, rel=1e-5)


def test_modifiers_are_applied(cube, tmp_path):
    cube.modifiers.new("Subdivision", "SUBSURF").levels = 2
    with np.load(export_mesh(cube, depsgraph(), tmp_path / "cube.npz")) as data:
        assert len(data["vertices"]) == 98


def test_mirrored_object_keeps_its_normals_outwards(cube, tmp_path):
    cube.scale.x = -1.0
    with np.load(export_mesh(cube, depsgraph(), tmp_path / "cube.npz")) as data:
        assert volume(data["vertices"], data["triangles"]) > 0.0


def test_pins_are_the_group_s_vertices(cube, tmp_path):
    group = cube.vertex_groups.new(name="Pin")
    group.add([1, 4, 6], 1.0, "REPLACE")
    group.add([5], 0.0, "REPLACE")
    pinned, weights = export_pins(cube, depsgraph(), "Pin", tmp_path / "pinned.npy")
    assert len(pinned) == 3 and weights is None
    assert np.load(tmp_path / "pinned.npy", allow_pickle=False).tolist() == [1, 4, 6]
    group.add([2], 0.25, "REPLACE")
    pinned, weights = export_pins(cube, depsgraph(), "Pin", tmp_path / "pinned.npy")
    assert len(pinned) == 4 and weights == tmp_path / "pinned.weights.npy"
    assert np.load(tmp_path / "pinned.npy", allow_pickle=False).tolist() == [1, 2, 4, 6]
    assert np.load(tmp_path / "pinned.weights.npy", allow_pickle=False).tolist() == [1.0, 0.25, 1.0, 1.0]


def test_pins_follow_modifiers(cube, tmp_path):
    """Pinned by one whole face; after subdivision the face's new vertices are pinned as well, those next to it half as firmly."""
    face = cube.data.polygons[0]
    cube.vertex_groups.new(name="Pin").add(list(face.vertices), 1.0, "REPLACE")
    modifier = cube.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.subdivision_type = 1, "SIMPLE"
    export_pins(cube, depsgraph(), "Pin", tmp_path / "pinned.npy")
    with np.load(export_mesh(cube, depsgraph(), tmp_path / "cube.npz")) as data:
        weights = np.load(tmp_path / "pinned.weights.npy")
        pinned = data["vertices"][np.load(tmp_path / "pinned.npy")][weights == 1.0]
    assert (weights[weights < 1.0] == 0.5).all() and (weights < 1.0).sum() == 8
    normal = cube.matrix_world.to_3x3().inverted().transposed() @ face.normal
    assert len(pinned) == 9 and np.ptp(pinned @ np.array(normal)) < 1e-6


def test_what_cannot_be_exported_is_refused(cube, tmp_path):
    with pytest.raises(UsageError, match="no vertex group 'Pin'"):
        export_pins(cube, depsgraph(), "Pin", tmp_path / "pinned.npy")
    cube.vertex_groups.new(name="Pin")
    with pytest.raises(UsageError, match="No vertex"):
        export_pins(cube, depsgraph(), "Pin", tmp_path / "pinned.npy")
    for name, data in (("Empty", None), ("Points", bpy.data.meshes.new("Points"))):
        obj = bpy.data.objects.new(name, data)
        bpy.context.scene.collection.objects.link(obj)
        with pytest.raises(UsageError, match="has no"):
            export_mesh(obj, depsgraph(), tmp_path / "none.npz")
    assert not list(tmp_path.iterdir())


def test_edit_is_what_the_engine_reads(tmp_path):
    bodies = [
        {
            "name": 'red "flag"',
            "mesh": Path("flag.npz"),
            "material": "cotton",
            "mass_scale": 2.0,
            "pin": None,
            "velocity": np.array([0.0, 1.0, 0.0]),
        },
        {"name": "leaf", "mesh": "recovered", "material": None, "start_frame": np.int64(3)},
    ]
    path = write_edit(tmp_path, bodies, (0.0, 0.0, -9.81), field_strength=[1.0, 0.5])
    edit = tomllib.loads(path.read_text(encoding="utf-8"))
    assert edit["gravity"] == [0.0, 0.0, -9.81] and edit["field_strength"] == [1.0, 0.5]
    assert edit["body"] == [
        {"name": 'red "flag"', "mesh": "flag.npz", "material": "cotton", "mass_scale": 2.0, "velocity": [0.0, 1.0, 0.0]},
        {"name": "leaf", "mesh": "recovered", "start_frame": 3},
    ]
    assert tomllib.loads(write_edit(tmp_path, [], None).read_text(encoding="utf-8")) == {"gravity": [0.0, 0.0, 0.0], "body": []}

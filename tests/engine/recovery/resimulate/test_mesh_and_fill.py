"""Meshes are read without surprises, and every mesh becomes particles."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.mpm.lattice.closed_mesh import signed_volume
from seeing_wind.engine.recovery.resimulate.fill import COUNT, fill
from seeing_wind.engine.recovery.resimulate.mesh import load_mesh

trimesh = pytest.importorskip("trimesh")


def test_obj_keeps_vertex_order_over_seams_objects_and_polygons(tmp_path):
    path = tmp_path / "two.obj"
    path.write_text("o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/2 3/1 4/2\no b\nv 0 0 5\nf -1/1/1 1//2 2\n")
    vertices, triangles = load_mesh(path)
    assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 5]]
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 0, 1]]


def test_ply_and_npz_give_the_same_mesh(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    box.export(tmp_path / "box.ply")
    np.savez(tmp_path / "box.npz", vertices=box.vertices, triangles=box.faces)
    for name in ("box.ply", "box.npz"):
        vertices, triangles = load_mesh(tmp_path / name)
        np.testing.assert_allclose(vertices, box.vertices, atol=1e-6)
        np.testing.assert_array_equal(triangles, box.faces)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("none.obj", None, "no mesh"),
        ("text.obj", "hello\n", "no triangles"),
        ("index.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n", "names vertex 9 of 2"),
        ("nan.obj", "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "vertex 1 is not finite"),
        ("word.obj", "v 0 0 zero\n", "line 1"),
        ("empty.obj", "", "^empty.obj: it is empty"),
        ("short.obj", "v 0 0\nf 1 1 1\n", "three coordinates"),
        ("broken.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "PLY"),
        ("broken.npz", "not a zip", "NPZ"),
        ("scene.blend", "x", "format"),
    ],
)
def test_bad_meshes_are_refused_with_a_sentence(tmp_path, name, content, says):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(UsageError, match=says) as raised:
        load_mesh(tmp_path / name)
    assert raised.value.hint


def test_npz_with_pickled_objects_is_refused(tmp_path):
    np.savez(tmp_path / "evil.npz", vertices=np.array([{}], dtype=object), triangles=np.zeros((1, 3), int))
    with pytest.raises(UsageError, match="not plain numbers"):
        load_mesh(tmp_path / "evil.npz")


@pytest.mark.parametrize("shape", ["box", "ball", "ring", "two"])
def test_volumes_sum_to_the_closed_mesh(shape):
    small = trimesh.creation.box((0.05,) * 3).apply_translation((1, 0, 0))
    mesh = {
        "box": lambda: trimesh.creation.box((0.2, 0.3, 0.1)),
        "ball": lambda: trimesh.creation.icosphere(subdivisions=3, radius=0.2),
        "ring": lambda: trimesh.creation.torus(0.3, 0.1),
        "two": lambda: trimesh.util.concatenate([trimesh.creation.box((0.1,) * 3), small]),
    }[shape]()
    particles = fill(mesh.vertices, mesh.faces).particles
    assert particles.volume.sum() == pytest.approx(mesh.volume, rel=1e-9)
    assert 0.7 * COUNT < len(particles.x) < 1.4 * COUNT
    assert particles.volume.mean() == pytest.approx(particles.spacing**3, rel=0.2)
    centre = np.average(particles.x, axis=0, weights=particles.volume)
    np.testing.assert_allclose(centre, mesh.center_mass, atol=0.7 * particles.spacing)


def test_inside_follows_the_shape_of_a_ball():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.2)
    particles = fill(ball.vertices, ball.faces, spacing=0.02).particles
    radius = np.linalg.norm(particles.x, axis=1)
    assert radius.max() <= 0.2
    assert len(particles.x) == pytest.approx(4 / 3 * np.pi * 10**3, rel=0.03)


def test_a_hollow_ball_is_filled_in_its_wall_only():
    outer, inner = trimesh.creation.icosphere(subdivisions=3, radius=0.2), trimesh.creation.icosphere(subdivisions=3, radius=0.12)
    inner.invert()
    mesh = trimesh.util.concatenate([outer, inner])
    particles = fill(mesh.vertices, mesh.faces, spacing=0.02).particles
    assert np.linalg.norm(particles.x, axis=1).min() > 0.115
    assert particles.volume.sum() == pytest.approx(mesh.volume, rel=1e-9)


def test_an_open_sheet_becomes_a_shell_of_two_layers(sheet):
    vertices, triangles = sheet(0.3, 0.2)
    filling = fill(vertices, triangles)
    particles = filling.particles
    assert 1300 < len(particles.x) < 2800
    assert particles.volume.sum() == pytest.approx(0.06 * 2 * particles.spacing, rel=1e-9)
    np.testing.assert_allclose(np.abs(particles.x[:, 1]), particles.spacing / 2, atol=1e-9)
    assert any("filled as a layer" in note for note in filling.notes), "it is no shell, which the edit may have refused"


def test_a_thin_closed_box_keeps_its_volume_and_gets_particles():
    paper = trimesh.creation.box((0.3, 0.0002, 0.2))
    filling = fill(paper.vertices, paper.faces)
    assert len(filling.particles.x) > 500
    assert filling.particles.volume.sum() == pytest.approx(0.3 * 0.0002 * 0.2, rel=1e-6)
    assert any("thinner" in note for note in filling.notes)


def test_every_part_gets_particles_and_seams_do_not_open_a_mesh():
    box, crumb = trimesh.creation.box((0.2,) * 3), trimesh.creation.box((0.01,) * 3).apply_translation((0.5, 0, 0))
    mesh = trimesh.util.concatenate([box, crumb])
    soup = mesh.vertices[mesh.faces].reshape(-1, 3)  # every triangle with corners of its own
    particles = fill(soup, np.arange(len(soup)).reshape(-1, 3)).particles
    assert (particles.x[:, 0] > 0.4).any()
    assert particles.volume.sum() == pytest.approx(mesh.volume, rel=1e-6)


def test_what_cannot_be_filled_is_refused(sheet):
    vertices, triangles = sheet(0.3, 0.2)
    with pytest.raises(UsageError, match="0 m apart"):
        fill(vertices, triangles, spacing=0.0)
    with pytest.raises(UsageError, match="no area"):
        fill(vertices * [1, 0, 0], triangles)


def test_signed_volume_does_not_depend_on_the_place():
    box = trimesh.creation.box((1, 2, 3))
    assert signed_volume(box.vertices + 100.0, box.faces) == pytest.approx(6.0)


def broken_boxes() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """A box of 0.2 x 0.3 x 0.1 m that is no proper solid, in ways that modellers make."""
    box = trimesh.creation.box((0.2, 0.3, 0.1)).subdivide().subdivide().subdivide()
    vertices, faces = np.array(box.vertices), np.array(box.faces)
    turned = faces.copy()
    turned[::3] = turned[::3, ::-1]
    inner = np.array([[-0.1, -0.15, -0.05], [0.1, -0.15, -0.05], [0.1, 0.15, 0.05], [-0.1, 0.15, 0.05]])
    return {
        "faces turned": (vertices, turned),
        "a face missing": (vertices, faces[1:]),
        "a wall inside": (np.concatenate([vertices, inner]), np.concatenate([faces, len(vertices) + np.array([[0, 1, 2], [0, 2, 3]])])),
    }


@pytest.mark.parametrize("kind", ["faces turned", "a face missing", "a wall inside"])
def test_what_is_no_proper_solid_is_filled_where_it_encloses_something(kind):
    vertices, faces = broken_boxes()[kind]
    filling = fill(vertices, faces)
    particles = filling.particles
    assert particles.volume.sum() == pytest.approx(0.2 * 0.3 * 0.1, rel=0.05)
    assert 0.7 * COUNT < len(particles.x) < 1.4 * COUNT
    np.testing.assert_allclose(np.ptp(particles.x, axis=0), [0.2, 0.3, 0.1], atol=2.1 * particles.spacing)
    assert any("not a closed solid" in note for note in filling.notes) and not any("shell" in note for note in filling.notes)


def test_an_open_bowl_holds_nothing():
    box = trimesh.creation.box((0.2, 0.2, 0.2)).subdivide()
    faces = np.array(box.faces)[np.array(box.triangles_center)[:, 2] < 0.09]
    filling = fill(np.array(box.vertices), faces)
    distance = np.abs(np.abs(filling.particles.x) - 0.1).min(axis=1)
    assert distance.max() < filling.particles.spacing, "particles only along the walls"
    assert any("filled as a layer" in note for note in filling.notes), "it is no shell, which the edit may have refused"


def test_a_sheet_beside_a_broken_solid_stays_a_sheet(sheet):
    vertices, faces = broken_boxes()["faces turned"]
    flag, triangles = sheet(0.3, 0.2)
    filling = fill(np.concatenate([vertices, flag + [0.2, 0.0, 0.0]]), np.concatenate([faces, triangles + len(vertices)]))
    beyond = filling.particles.x[:, 0] > 0.15
    assert beyond.sum() > 100 and np.abs(filling.particles.x[beyond, 1]).max() < filling.particles.spacing
    assert filling.particles.volume[~beyond].sum() == pytest.approx(0.006, rel=0.05)

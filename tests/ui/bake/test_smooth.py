"""Ripples of an edge's length go out of a bake; bends, borders, pins and what the mesh is at rest stay."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.take import Take
from seeing_wind.ui.bake.rigid import rigid_fit
from seeing_wind.ui.bake.smooth import smoothed
from seeing_wind.ui.job import takes
from tests.ui.jobs import now, recover

SIDE, CELLS = 0.8, 32
EDGE = SIDE / CELLS


@pytest.fixture
def cloth() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and edges (E, 2) of a square of cloth with creased corners at rest, of triangles."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=CELLS, y_subdivisions=CELLS, size=SIDE)
    obj = bpy.context.object
    obj.modifiers.new("Triangles", "TRIANGULATE")
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    vertices = np.array([vertex.co[:] for vertex in mesh.vertices])
    vertices[:, 2] = 0.02 * np.abs(vertices[:, 0])  # a crease
    return vertices, np.array([edge.vertices[:] for edge in mesh.edges])


def rolled(vertices: np.ndarray, curvature: float) -> np.ndarray:
    """Rolled up along X to a cylinder of this curvature [1/m]."""
    x, y, z = vertices.T
    radius = 1.0 / curvature - z
    return np.stack([radius * np.sin(curvature * x), y, 1.0 / curvature - radius * np.cos(curvature * x)], axis=1)


def off(found: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square distance over an edge's length."""
    return float(np.sqrt(((found - truth) ** 2).sum(axis=-1).mean()) / EDGE)


def test_pucker_of_the_review_goes_and_the_bend_stays(cloth) -> None:
    """1.2 mm of noise on edges of 25 mm, as was measured, on a sheet that rolls up with a radius of 0.4 m."""
    vertices, edges = cloth
    truth = np.stack([rolled(vertices, curvature) for curvature in np.linspace(1e-3, 2.5, 6)])
    noise = 0.0012 / np.sqrt(3.0) * np.random.default_rng(1).normal(size=truth.shape)
    noise[0] = 0.0
    found = smoothed(truth + noise, edges, rigid_fit(truth), 4)
    assert off(found[1:], truth[1:]) < 0.6 * off((truth + noise)[1:], truth[1:])
    assert off(smoothed(truth, edges, rigid_fit(truth), 4), truth) < 0.004, "a bend is no ripple"

    def quilt(motion: np.ndarray) -> float:
        """Differences between neighbouring edges' slopes along X: what shading shows."""
        rows = motion[-1].reshape(CELLS + 1, CELLS + 1, 3)
        return float(np.sqrt((np.diff(rows, n=4, axis=1) ** 2).sum(axis=-1).mean()))

    assert quilt(found) < 0.3 * quilt(truth + noise)


def test_every_linear_motion_and_what_is_held_stays(cloth) -> None:
    vertices, edges = cloth
    stretched = np.stack([vertices, vertices @ np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.3], [0.1, 0.0, 1.0]]) + [0.3, 0.0, 1.0]])
    assert np.abs(smoothed(stretched, edges, rigid_fit(stretched), 5) - stretched).max() < 1e-9
    rough = np.stack([vertices, vertices + 0.002 * np.random.default_rng(2).normal(size=vertices.shape)])
    held = vertices[:, 1] > 0.5 * SIDE - 1e-6
    rough[1, held] = vertices[held]
    found = smoothed(rough, edges, rigid_fit(rough), 3)
    assert np.abs(found[:, held] - vertices[held]).max() < 1e-12 and np.array_equal(found[0], vertices)
    assert np.array_equal(smoothed(rough, edges, rigid_fit(rough), 0), rough)


def simulate_a_sheet(workplace: Path) -> None:
    """A grid of the name *Sheet* in a recovered field."""
    recover(workplace)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=6, y_subdivisions=6, size=0.3)
    bpy.context.object.name = "Sheet"
    bpy.ops.seeing_wind.insert_mesh(object="Sheet")
    bpy.ops.seeing_wind.resimulate()


@pytest.mark.usefixtures("stand_in")
def test_the_setting_reaches_the_bake_and_makes_it_stale(scene, workplace) -> None:
    simulate_a_sheet(workplace)
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
    assert now(scene)["bake"].state == "done"
    scene.seeing_wind.bake_smooth = 0
    assert now(scene)["bake"].state == "stale"


@pytest.mark.usefixtures("stand_in")
def test_cloth_keeps_the_lengths_that_were_simulated(scene, workplace) -> None:
    """A shell's ripples are its own: smoothing took 5.7 % off the edges of a crumpled one."""
    simulate_a_sheet(workplace)
    settings = scene.seeing_wind
    take, result = Take(takes.simulated(settings)), next(body.result for body in settings.bodies if body.object)
    arrays = take.read_arrays(f"bodies/{result}.npz")
    rough = arrays["vertices"] + 0.01 * np.random.default_rng(4).normal(size=arrays["vertices"].shape)
    baked = {}
    for shell in (False, True):
        take.write_arrays(f"bodies/{result}.npz", arrays | {"vertices": rough, "shell": np.array(shell)})
        bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")
        key = bpy.data.objects["Sheet"].data.shape_keys.key_blocks[-1]
        baked[shell] = np.array([point.co[:] for point in key.data])
    assert np.abs(baked[True] - baked[False]).max() > 0.002, "a solid's ripples go"
    assert np.abs(baked[True] - rough[-1]).max() < 1e-4

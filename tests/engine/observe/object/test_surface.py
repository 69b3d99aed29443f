"""The closed mesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from seeing_wind.engine.errors import ObjectError
from seeing_wind.engine.observe.object.shape.particles import fill
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.observe.object.shape.surface import boundary_edges, silhouette_triangles, surface_of, without_pinches
from tests.engine.observations import observed


def mesh_of(observation) -> tuple[trimesh.Trimesh, object, float]:
    relief = relief_of(observation)
    particles = fill(relief, 200)
    surface = surface_of(relief, particles.x)
    return trimesh.Trimesh(surface.vertices, surface.triangles, process=False), surface, relief.pixel_volume().sum()


def ragged() -> np.ndarray:
    """A blob with a hole, a bay, a one-pixel bridge and two squares that touch at a corner."""
    mask = np.zeros((72, 96), dtype=bool)
    mask[10:50, 10:50] = True
    mask[25:35, 25:35] = False
    mask[10:20, 30:34] = False
    mask[50:60, 50:60] = True
    mask[40, 50:70] = True
    mask[30:50, 70:90] = True
    return mask


@pytest.mark.parametrize("name", ["plate", "ball", "ragged"])
def test_closed_and_outward(name: str, request) -> None:
    observation = observed(ragged(), 1.0) if name == "ragged" else request.getfixturevalue(name)
    mesh, surface, volume = mesh_of(observation)
    edges, counts = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
    assert (counts == 2).all()
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume, rel=0.12)
    assert 20 <= len(surface.vertices) <= 2000
    assert surface.triangles.dtype == np.int32


def test_front_looks_at_the_camera_and_uv_lies_in_the_frame(plate) -> None:
    mesh, surface, _ = mesh_of(plate)
    front = (surface.triangles < len(surface.vertices) // 2).all(axis=1)
    to_camera = plate.camera.pose(0)[:3, 3] - mesh.triangles_center[front]
    assert ((mesh.face_normals[front] * to_camera).sum(axis=1) > 0).all()
    half = len(surface.vertices) // 2
    xy, _ = plate.camera.project(surface.vertices[:half])
    height, width = plate.masks[0].shape
    assert surface.uv[:half, 0] * width - 0.5 == pytest.approx(xy[:, 0], abs=1e-6)
    assert (1.0 - surface.uv[:half, 1]) * height - 0.5 == pytest.approx(xy[:, 1], abs=1e-6)
    # The outline is the mask's own, to a fraction of a pixel: 40 x 24 pixels with rounded corners.
    assert np.ptp(xy, axis=0) == pytest.approx([40.0, 24.0], abs=0.4)


def test_vertices_ride_on_the_particles(plate) -> None:
    relief = relief_of(plate)
    particles = fill(relief, 200)
    surface = surface_of(relief, particles.x)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    error = surface.attachment.follow(particles.x @ turn.T) - surface.vertices @ turn.T
    assert np.abs(error).max() < 0.1 * particles.spacing


def test_pinched_fans_are_cut() -> None:
    bow_tie = np.array([[0, 1, 2], [1, 3, 2], [2, 4, 5]])
    assert without_pinches(bow_tie).tolist() == [[0, 1, 2], [1, 3, 2]]
    assert len(boundary_edges(bow_tie[:2])) == 4


def test_silhouette_too_thin() -> None:
    mask = np.zeros((20, 40), dtype=bool)
    mask[10, 5:25] = True
    with pytest.raises(ObjectError):
        silhouette_triangles(mask & False, 2.0)

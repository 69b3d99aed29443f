"""Bodies that meet planes and meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.errors import SimulationError, UsageError
from seeing_wind.engine.mpm.autograd import simulate
from seeing_wind.engine.mpm.lattice.colliders import INSET, Plane, collider_grid, collider_notes
from seeing_wind.engine.mpm.lattice.mesh_collider import MeshCollider
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from tests.engine.mpm.bodies import RUBBER, SPACING, block

trimesh = pytest.importorskip("trimesh")

G = 9.81
STIFF = replace(RUBBER, youngs_modulus=1e5)


def mesh_of(shape, **options):
    return MeshCollider(np.asarray(shape.vertices), np.asarray(shape.faces), **options)


def turned(angle):
    """Rotation about Y that lifts +X up by `angle` [rad]... downhill is R @ (1, 0, 0)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def slab():
    """A slab whose underside lies in z = 0."""
    body = block((8, 8, 3), jitter=0.0)
    return replace(body, x=body.x + [0.0, 0.0, 0.5 * SPACING])


def run(body, colliders, frames, *, gravity=(0, 0, -G), v=None, fps=30.0, material=STIFF):
    model, notes = model_for(body, material, fps, gravity=gravity, colliders=colliders)
    return rollout(model, State.at_rest(body.x, v), np.zeros((frames, model.particles, 3))), model, notes


# -- planes -----------------------------------------------------------------------------------------------------------------------


def test_a_fallen_body_lies_on_the_floor():
    body = slab()
    path, model, notes = run(replace(body, x=body.x + [0.0, 0.0, 0.01]), [Plane((0, 0, 0), (0, 0, 2))], 16)
    underside = path.x[:, body.x[:, 2] < SPACING, 2].mean(axis=1) - 0.5 * SPACING
    assert not notes
    assert np.abs(underside[8:]).mean() < 0.2 * model.dx and underside.min() > -0.3 * model.dx


@pytest.mark.parametrize("mu", [0.0, 0.2, 0.5])
def test_a_slab_on_an_incline_slides_or_stops_as_coulomb_says(mu):
    angle = np.radians(20.0)
    R = turned(angle)
    flat = slab()
    body = replace(flat, x=flat.x @ R.T)
    path, _, _ = run(body, [Plane((0, 0, 0), tuple(R @ [0, 0, 1]), friction=mu)], 10)
    speed = path.v.mean(axis=1) @ (R @ [1.0, 0.0, 0.0])
    expected = G * max(0.0, np.sin(angle) - mu * np.cos(angle)) * np.arange(11) / 30.0
    assert np.allclose(speed, expected, atol=0.03 * G * np.sin(angle) * 10 / 30.0)


def test_sticky_ground_holds_a_slab_that_would_slide():
    body = slab()
    path, _, _ = run(body, [Plane((0, 0, 0), (0, 0, 1), kind="sticky")], 6, gravity=(3.0, 0.0, -G))
    assert np.abs(path.x[-1] - path.x[0]).max() < 0.2 * SPACING


def test_a_body_thrown_about_in_a_closed_room_never_leaves_it():
    body = block((4, 4, 4), jitter=0.0)
    body = replace(body, x=body.x + [0.03, 0.03, 0.03])
    inwards = np.concatenate([np.eye(3), -np.eye(3)])
    room = [Plane(tuple(np.where(n < 0.0, 0.12, 0.0)), tuple(n), friction=0.1) for n in inwards]
    path, model, _ = run(body, room, 20, v=[2.0, 1.3, -1.1])
    assert path.x.min() > -0.5 * model.dx and path.x.max() < 0.12 + 0.5 * model.dx
    centre = path.x.mean(axis=1)
    assert (np.abs(np.diff(np.sign(np.diff(centre, axis=0)), axis=0)) > 0).any(axis=0).all()  # it turned back along every axis
    energy = 0.5 * (path.v**2).sum(-1).mean(axis=1) + G * centre[:, 2]
    assert (energy <= energy[0] * 1.001).all()


def test_a_floor_takes_the_momentum_that_arrives():
    # Frictionless and level: sideways momentum stays, whatever happens vertically.
    body = slab()
    path, model, _ = run(body, [Plane((0, 0, 0), (0, 0, 1))], 8, v=[0.7, -0.3, -1.0])
    momentum = (model.mass[:, None] * path.v).sum(axis=1)
    assert np.allclose(momentum[:, :2], momentum[0, :2], rtol=1e-9)
    assert momentum[-1, 2] > momentum[0, 2]


# -- meshes -----------------------------------------------------------------------------------------------------------------------


def test_a_large_cube_acts_as_the_plane_of_its_face():
    R = turned(np.radians(20.0))
    flat = slab()
    body = replace(flat, x=flat.x @ R.T)
    cube = trimesh.creation.box((1.0, 0.6, 0.3))
    solid = MeshCollider((np.asarray(cube.vertices) - [0, 0, 0.15]) @ R.T, np.asarray(cube.faces), friction=0.2)
    on_mesh = run(body, [solid], 6)[0]
    on_plane = run(body, [Plane((0, 0, 0), tuple(R @ [0, 0, 1]), friction=0.2)], 6)[0]
    assert np.allclose(on_mesh.x, on_plane.x, atol=1e-7)


def test_a_ball_holds_a_body_up_at_its_top_and_lets_it_slip_off_beside():
    ball = mesh_of(trimesh.creation.icosphere(subdivisions=3, radius=0.1))
    body = block((3, 3, 3), jitter=0.0)
    above = replace(body, x=body.x - body.x.mean(axis=0) + [0.0, 0.0, 0.1 + 2.5 * SPACING])
    path, model, _ = run(above, [ball], 10)
    distance = np.linalg.norm(path.x, axis=-1)
    assert distance.min() > 0.1 - 0.6 * model.dx
    assert path.x[-1].mean(axis=0)[2] > 0.1
    beside = replace(above, x=above.x + [0.06, 0.0, 0.0])
    off = run(beside, [ball], 10)[0].x[-1].mean(axis=0)
    assert off[0] > 0.065 and off[2] < 0.1


def test_signed_distance_of_a_ball():
    radius, dx, offset = 0.3, 0.03, np.array([0.001, 0.002, 0.003])
    grid = collider_grid([mesh_of(trimesh.creation.icosphere(subdivisions=4, radius=radius), friction=0.3)], offset, dx)
    nodes = offset + dx * (np.stack(np.indices(grid.depth.shape), -1) + grid.solid_lo)
    below = radius - np.linalg.norm(nodes, axis=-1)
    assert ((grid.depth > 0) == (below > 0))[np.abs(below) > 0.01 * radius].all()
    near = (grid.depth > 0) & (below < 2 * dx)
    assert np.allclose(grid.depth[near], below[near], atol=0.01 * radius)
    held = grid.solid[..., 0] > 0
    assert np.array_equal(held, grid.depth > (INSET - 0.5) * dx)
    outwards = (grid.solid[..., 1:4] * nodes).sum(-1) / np.linalg.norm(nodes, axis=-1)
    assert (outwards[held & near] > 0.99).all() and (grid.solid[held, 4] == 0.3).all()


def test_two_meshes_share_the_lattice():
    left, right = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.2, 0.2, 0.2))
    right.apply_translation([0.5, 0, 0])
    both = collider_grid([mesh_of(left), mesh_of(right, kind="sticky")], np.zeros(3), 0.02)
    assert {1.0, 3.0} <= set(np.unique(both.solid[..., 0]))
    assert both.depth.max() == pytest.approx(0.1, rel=0.2)


def test_a_mesh_may_be_wound_inwards_and_have_doubled_vertices():
    cube = trimesh.creation.box((0.2, 0.2, 0.2))
    vertices, faces = np.asarray(cube.vertices)[np.asarray(cube.faces)].reshape(-1, 3), np.arange(36).reshape(12, 3)
    grids = [collider_grid([MeshCollider(vertices, f)], np.full(3, 0.003), 0.02) for f in (faces, faces[:, ::-1])]
    assert np.allclose(grids[0].depth, grids[1].depth) and np.array_equal(grids[0].solid[..., 0], grids[1].solid[..., 0])


# -- gradients --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["corotated", "neo_hookean"])
def test_gradients_through_contact_match_finite_differences(law):
    body = block((3, 3, 3))
    cube = trimesh.creation.box((0.3, 0.3, 0.1))
    cube.apply_translation([0.0, 0.0, -0.054])
    colliders = [Plane((-0.012, 0, 0), (1, 0.2, 0), friction=0.3), mesh_of(cube, friction=0.4)]
    model, _ = model_for(body, replace(RUBBER, law=law), 30.0, colliders=colliders)
    model = replace(model, substeps=20, frame_dt=model.frame_dt / model.substeps * 20)
    rng = np.random.default_rng(0)
    v = rng.normal(size=body.x.shape) * 0.1 + [-1.0, 0.3, -1.0]
    inputs = [body.x, v, 3 * rng.normal(size=(2, *body.x.shape))]
    weight = rng.normal(size=(2, 3, *body.x.shape))

    def loss(x, v, acceleration):
        path = rollout(model, State.at_rest(x, v), acceleration)
        return (weight[0] * path.x).sum() + (weight[1] * path.v).sum()

    tensors = [torch.tensor(array, requires_grad=True) for array in inputs]
    x, v, _, _ = simulate(model, *tensors)
    ((torch.tensor(weight[0]) * x).sum() + (torch.tensor(weight[1]) * v).sum()).backward()
    free = simulate(replace(model, collider_grid=collider_grid([], model.offset, model.dx)), *tensors)[1]
    assert not torch.allclose(free, v, atol=0.05)  # there was contact
    for which, h in enumerate((1e-9, 1e-6, 1e-3)):
        direction = rng.normal(size=inputs[which].shape)
        ends = []
        for sign in (1, -1):
            moved = list(inputs)
            moved[which] = inputs[which] + sign * h * direction
            ends.append(loss(*moved))
        numeric = (ends[0] - ends[1]) / (2 * h)
        assert (tensors[which].grad.numpy() * direction).sum() == pytest.approx(numeric, rel=1e-5), which


# -- what is refused --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make, match",
    [
        (lambda: Plane((0, 0, np.nan), (0, 0, 1)), "point"),
        (lambda: Plane((0, 0, 0), (0, 0, 0)), "no length"),
        (lambda: Plane((0, 0, 0), (0, 0, 1), kind="bouncy"), "sticky, slip, separate"),
        (lambda: Plane((0, 0, 0), (0, 0, 1), friction=-0.1), "friction"),
        (lambda: Plane((0, 0, 0), (0, 0, 1), friction=np.inf), "friction"),
        (lambda: MeshCollider(np.eye(3), np.array([[0, 1, 2]])), "open"),
        (lambda: MeshCollider(np.eye(3), np.array([[0, 1, 3]])), "refers to a vertex"),
        (lambda: MeshCollider(np.full((3, 3), np.nan), np.array([[0, 1, 2]])), "not finite"),
        (lambda: MeshCollider(np.zeros((0, 3)), np.zeros((0, 3), int)), "shape"),
        (lambda: MeshCollider(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]])), "no volume"),
    ],
)
def test_bad_colliders_are_refused_with_advice(make, match):
    with pytest.raises(UsageError, match=match) as caught:
        make()
    assert caught.value.hint


def test_a_list_of_something_else_is_refused():
    with pytest.raises(UsageError, match="str is no collider"):
        model_for(block(), RUBBER, 30.0, colliders=["floor"])


def test_a_mesh_too_large_for_the_lattice_is_an_error():
    with pytest.raises(SimulationError, match="plane for a large floor"):
        model_for(block(), RUBBER, 30.0, colliders=[mesh_of(trimesh.creation.box((10, 10, 0.5)))])


def test_a_body_that_starts_inside_is_told_how_deep():
    body = block((4, 4, 4), jitter=0.0)
    wall = Plane((0.0, 0.0, 0.012), (0.0, 0.0, 1.0))
    _, notes = model_for(body, RUBBER, 30.0, colliders=[wall])
    assert len(notes) == 1 and "32 of 64" in notes[0] and "12 mm" in notes[0]
    cube = trimesh.creation.box((0.4, 0.4, 0.2))
    cube.apply_translation([0, 0, 0.012 - 0.1])
    _, notes = model_for(body, RUBBER, 30.0, colliders=[mesh_of(cube)])
    assert len(notes) == 1 and "32 of 64" in notes[0]


def test_a_sheet_too_thin_to_collide_with_is_mentioned():
    sheet = mesh_of(trimesh.creation.box((0.3, 0.3, 0.004)))
    grid = collider_grid([sheet], np.zeros(3), 0.016)
    notes = collider_notes(np.array([[0.0, 0.0, 0.5]]), [sheet], grid, np.zeros(3), 0.016)
    assert len(notes) == 1 and "3.9" in notes[0] and "48 mm" in notes[0]

"""Velocity conditions at nodes: the contact law in closed form, and its derivative. No postponed annotations: the compiler reads them."""

import numpy as np
import pytest

from seeing_wind.engine.mpm.compiler import device, ti
from seeing_wind.engine.mpm.compiler.settings import compiled_in, compiled_sooner
from seeing_wind.engine.mpm.lattice.conditions import SEPARATE, SLIP, STICKY, boundary_jacobian, boundary_velocity

rows = ti.types.ndarray(ndim=2)


@ti.kernel
def velocities(
    real: ti.template(), node: rows, v: rows, clamp: ti.types.ndarray(dtype=ti.i32, ndim=3), clamp_velocity: ti.types.ndarray(ndim=4),
    planes: rows, solid: ti.types.ndarray(ndim=4), v_out: rows, v_out_bar: rows, v_bar: rows,
):  # fmt: skip
    """With dx = 0.5, offset 0, and both boxes starting at node (0, 0, 0)."""
    for p in range(v.shape[0]):
        zero, lo = ti.Vector.zero(float, 3), ti.Vector([0, 0, 0])
        at = ti.Vector([ti.cast(node[p, a], ti.i32) for a in ti.static(range(3))])
        own = ti.Vector([v[p, a] for a in ti.static(range(3))])
        bar = ti.Vector([v_out_bar[p, a] for a in ti.static(range(3))])
        out = boundary_velocity(at, own, zero, 0.5, lo, clamp, clamp_velocity, planes, lo, solid)
        back = boundary_jacobian(at, own, zero, 0.5, lo, clamp, planes, lo, solid).transpose() @ bar
        for a in ti.static(range(3)):
            v_out[p, a] = out[a]
            v_bar[p, a] = back[a]


class Walls:
    """Conditions to try: planes as (normal, offset, kind, friction), one solid node and one clamped node."""

    def __init__(self, *planes, solid=None, clamp=None):
        self.planes = np.zeros((max(1, len(planes)), 8))
        for row, (normal, offset, kind, friction) in zip(self.planes, planes):
            row[:6] = [*normal, offset, kind, friction]
        self.solid = np.zeros((3, 3, 3, 8))
        if solid is not None:
            self.solid[1, 1, 1] = solid
        self.clamp, self.clamp_velocity = np.zeros((3, 3, 3), np.int32), np.zeros((3, 3, 3, 3))
        if clamp is not None:
            self.clamp[2, 2, 2], self.clamp_velocity[2, 2, 2] = 1, clamp

    def __call__(self, node, v, v_out_bar=None, real=np.float64):
        """v_out, and v_bar of v_out_bar."""
        device.start()
        v = np.atleast_2d(np.asarray(v, real))
        nodes = np.broadcast_to(np.asarray(node, real), v.shape).copy()
        bar = np.zeros_like(v) if v_out_bar is None else np.asarray(v_out_bar, real)
        out, back = np.empty_like(v), np.empty_like(v)
        arrays = [np.ascontiguousarray(array, real) for array in (self.clamp_velocity, self.planes, self.solid)]
        with compiled_sooner(), compiled_in(real):
            velocities(real == np.float64, nodes, v, self.clamp, *arrays, out, bar, back)
        return out, back


UP = (0.0, 0.0, 1.0)
BELOW, ABOVE = (0, 0, -1), (0, 0, 1)


def test_only_nodes_behind_the_plane_feel_it():
    floor = Walls((UP, 0.0, STICKY, 0.0))
    assert np.array_equal(floor(ABOVE, [1.0, 2.0, -3.0])[0], [[1.0, 2.0, -3.0]])
    assert np.array_equal(floor(BELOW, [1.0, 2.0, -3.0])[0], [[0.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    "kind, v, out",
    [
        (SLIP, [1.0, 2.0, -3.0], [1.0, 2.0, 0.0]),
        (SLIP, [1.0, 2.0, 3.0], [1.0, 2.0, 0.0]),
        (SEPARATE, [1.0, 2.0, -3.0], [1.0, 2.0, 0.0]),
        (SEPARATE, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
    ],
)
def test_slip_holds_both_ways_and_separate_one_way(kind, v, out):
    assert np.allclose(Walls((UP, 0.0, kind, 0.0))(BELOW, v)[0], [out], atol=1e-15)


def test_friction_takes_mu_times_the_normal_loss():
    floor = Walls((UP, 0.0, SEPARATE, 0.5))
    assert np.allclose(floor(BELOW, [3.0, 4.0, -2.0])[0], [[3.0 * 0.8, 4.0 * 0.8, 0.0]])  # 5 m/s less 0.5 * 2
    assert np.array_equal(floor(BELOW, [0.3, 0.4, -2.0])[0], [[0.0, 0.0, 0.0]])
    assert np.array_equal(floor(BELOW, [0.3, 0.4, 2.0])[0], [[0.3, 0.4, 2.0]])


def test_a_corner_of_two_walls_lets_nothing_through():
    corner = Walls((UP, 0.0, SEPARATE, 0.3), ((1.0, 0.0, 0.0), 0.0, SEPARATE, 0.3))
    out = corner((-1, 0, -1), np.random.default_rng(0).normal(size=(50, 3)))[0]
    assert (out[:, [0, 2]] >= 0.0).all()


def test_solids_move_with_their_wall_and_pins_win():
    walls = Walls((UP, 5.0, STICKY, 0.0), solid=[SLIP, 1.0, 0.0, 0.0, 0.0, 7.0, 0.0, 0.0], clamp=[1.0, 2.0, 3.0])
    assert np.array_equal(walls((1, 1, 1), [9.0, 9.0, 9.0])[0], [[7.0, 0.0, 0.0]])
    out, back = walls((2, 2, 2), [9.0, 9.0, 9.0], [[1.0, 1.0, 1.0]])
    assert np.array_equal(out, [[1.0, 2.0, 3.0]]) and not back.any()


@pytest.mark.parametrize("kind", [STICKY, SLIP, SEPARATE])
@pytest.mark.parametrize("friction", [0.0, 0.3, 2.0])
def test_adjoint_matches_finite_differences(kind, friction):
    rng = np.random.default_rng(1)
    tilted = np.array([0.36, -0.48, 0.8])
    walls = Walls((UP, 9.0, SEPARATE, 0.2), (tilted, 9.0, kind, friction), solid=[kind, *tilted[::-1], friction, 0.1, 0.2, 0.3])
    v, bar = rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    back = walls((1, 1, 1), v, bar)[1]
    h = 1e-6
    for _ in range(3):
        direction = rng.normal(size=v.shape)
        ahead, behind = walls((1, 1, 1), v + h * direction)[0], walls((1, 1, 1), v - h * direction)[0]
        numeric = ((ahead - behind) * bar).sum(1) / (2 * h)
        assert np.allclose((back * direction).sum(1), numeric, rtol=1e-6, atol=1e-8)


def test_sliding_along_a_frictionless_wall_from_rest_has_a_derivative():
    back = Walls((UP, 0.0, SEPARATE, 0.0))(BELOW, [0.0, 0.0, -1.0], [[1.0, 2.0, 3.0]])[1]
    assert np.array_equal(back, [[1.0, 2.0, 0.0]])


def test_single_precision_agrees():
    rng = np.random.default_rng(2)
    walls = Walls((UP, 9.0, SEPARATE, 0.4), solid=[SLIP, 0.6, 0.0, 0.8, 0.3, 0.1, 0.2, 0.3])
    v, bar = rng.normal(size=(100, 3)), rng.normal(size=(100, 3))
    for single, double in zip(walls((1, 1, 1), v, bar, np.float32), walls((1, 1, 1), v, bar)):
        assert single.dtype == np.float32 and np.abs(single - double).max() < 1e-5

"""Camera maths and attachments against closed forms."""

from __future__ import annotations

import numpy as np

from seeing_wind.engine.conventions import front_view, lame
from seeing_wind.engine.records import Attachment, Camera


def camera() -> Camera:
    return Camera(640, 360, 600.0, 610.0, 319.5, 179.5, front_view(2.0))


def test_front_view_has_x_right_and_z_up() -> None:
    xy, depth = camera().project(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 1.0, 0.0]]))
    np.testing.assert_allclose(xy, [[319.5, 179.5], [349.5, 179.5], [319.5, 149.0], [319.5, 179.5]], atol=1e-9)
    np.testing.assert_allclose(depth, [2.0, 2.0, 2.0, 3.0])


def test_unproject_inverts_project() -> None:
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))
    xy, depth = camera().project(points)
    np.testing.assert_allclose(camera().unproject(xy, depth), points, atol=1e-12)


def test_projection_jacobian_against_finite_differences() -> None:
    points, step = np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3)), 1e-6
    numeric = np.stack(
        [(camera().project(points + step * e)[0] - camera().project(points - step * e)[0]) / (2 * step) for e in np.eye(3)], -1
    )
    np.testing.assert_allclose(camera().projection_jacobian(points), numeric, rtol=1e-6, atol=1e-5)


def test_a_moving_camera_has_a_pose_per_frame() -> None:
    poses = np.stack([front_view(2.0), front_view(4.0)])
    moving = Camera(640, 360, 600.0, 600.0, 319.5, 179.5, poses)
    assert moving.project(np.zeros(3), 0)[1] == 2.0 and moving.project(np.zeros(3), 1)[1] == 4.0


def test_attached_points_follow() -> None:
    attachment = Attachment(np.array([[0, 1], [2, 0]]), np.array([[0.25, 0.75], [1.0, 0.0]]))
    x = np.arange(18.0).reshape(2, 3, 3)
    np.testing.assert_allclose(attachment.follow(x)[1], [0.25 * x[1, 0] + 0.75 * x[1, 1], x[1, 2]])


def test_lame_parameters_give_back_the_modulus() -> None:
    mu, lam = lame(2e5, 0.3)
    np.testing.assert_allclose([mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))], [2e5, 0.3])

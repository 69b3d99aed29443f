"""The wind on a sheet that was seen in 3D: the simulation that follows it, its derivative, and what is recovered."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.trajectories.sheets import read_sheet
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.field import distillation
from seeing_wind.engine.look.report.accuracy import field_errors
from seeing_wind.engine.mpm.shell import shell_of
from seeing_wind.engine.mpm.shell import substep as room
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.prior.basis import hats, spatial_basis
from seeing_wind.engine.recovery.wind.sheet.air import Air, Push
from seeing_wind.engine.recovery.wind.sheet.estimate import field_of, follower_of
from seeing_wind.engine.recovery.wind.sheet.observed import observed
from seeing_wind.engine.recovery.wind.sheet.problem import SheetProblem
from tests.engine.recovery.wind.blown_sheet import FPS, FRAMES, GRAVITY, blown, mesh


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("sheet") / "flag.npz"
    np.savez(path, **blown())
    return path


def followed(path, cause=Air):
    source, gravity, _ = read_sheet(path)
    seen = observed(source.x, source.faces, source.fixed, source.fps, 0.0)
    shell = shell_of(seen.rest, source.faces, source.sheet, pinned=source.fixed)
    return follower_of(shell, replace(seen, faces=shell.surface.faces), gravity, cause(shell))


@pytest.mark.parametrize("cause", [Air, Push])
def test_the_derivative_of_what_is_seen_by_the_unknowns(file, cause, monkeypatch):
    """Against finite differences over the whole rollout; no knot is forgotten within so short a clip."""
    monkeypatch.setattr(room, "EXACT", 1e-9)
    monkeypatch.setattr(room, "LOOSE", 1e-4)
    follower = followed(file, cause)
    follower = replace(follower, seen=replace(follower.seen, x=follower.seen.x[:5]))
    mass = follower.shell.mass * ~follower.shell.pinned
    basis, views = spatial_basis(follower.seen.rest, mass, 3), spatial_basis(follower.seen.rest, mass, 6)
    problem = SheetProblem(follower, basis, views, mass / mass.sum(), hats(4, 2.0), np.full(12, 1e-3))
    rng = np.random.default_rng(0)
    theta, way = 0.3 * rng.normal(size=30), rng.normal(size=30)
    theta[-3:] = 1.0, 2.0, 0.5
    point = problem.linearise(theta)
    step = 1e-5
    numeric = (problem.residual(theta + step * way) - problem.residual(theta - step * way)) / (2.0 * step)
    np.testing.assert_allclose(way @ point.jacobian, numeric, atol=1e-4 * np.abs(numeric).max())
    np.testing.assert_allclose(point.residual, problem.residual(theta), atol=1e-9)


def test_a_wind_that_varies_is_found_from_noisy_points(file, tmp_path):
    noisy = tmp_path / "noisy.npz"
    np.savez(noisy, **blown(noise=5e-4))
    source, _, _ = read_sheet(noisy)
    truth, free = blown()["wind"], ~source.fixed
    found = field_of(followed(noisy), 20.0, NoProgress())
    size, angle = field_errors(truth, found.velocity, free)
    steady = np.broadcast_to(truth[:, free].mean(axis=(0, 1)), truth.shape)
    flat_size, flat_angle = field_errors(truth, steady, free)
    assert size < 15.0 and angle < 8.0
    assert size < flat_size and angle < flat_angle
    error = np.linalg.norm(found.velocity - truth, axis=-1)[:, free] / np.sqrt(3.0)
    assert np.median(error / found.deviation[:, free]) < 3.0
    assert found.unexplained < 0.2


def test_a_flat_sheet_stays_flat_at_rest_under_noise_and_a_bent_one_bent():
    x, faces = mesh()
    fixed = x[:, 0] < 1e-9
    noise = 5e-4 * np.random.default_rng(1).normal(size=(6, *x.shape))
    seen = observed(x + noise, faces, fixed, FPS, 5e-4)
    assert np.linalg.svd(seen.rest - seen.rest.mean(axis=0))[1][2] < 1e-9
    assert np.ptp(seen.pins, axis=0).max() == 0.0
    bent = x + np.array([0.0, 1.0, 0.0]) * (x[:, :1] ** 2)
    np.testing.assert_array_equal(observed(bent + 0.0 * noise, faces, fixed, FPS, 0.0).rest, bent)


def test_what_is_held_may_move():
    x, faces = mesh()
    fixed = x[:, 0] < 1e-9
    path = x + 0.01 * np.arange(8)[:, None, None] ** 2 * [0.0, 1.0, 0.0]
    seen = observed(path, faces, fixed, FPS, 0.0)
    np.testing.assert_allclose(seen.pins, path[:, fixed], atol=1e-12)


def test_the_verbs_from_outside(file, tmp_path, monkeypatch):
    """The default is a wind; sampled in m/s where the sheet was, beside the force that it makes; a second run has nothing to do."""
    monkeypatch.setattr(distillation, "ITERATIONS", 150)

    def run(*words):
        arguments = parser().parse_args([str(word) for word in words])
        return VERBS[arguments.verb](arguments, NoProgress())

    take = tmp_path / "flag.take"
    result = run("recover-trajectories", file, "--take", take, "--report", "none")
    assert result["outcome"] in ("converged", "max_iterations") and result["wind"]["field"] == "wind"
    values = blown()
    points = tmp_path / "points.npy"
    np.save(points, values["x"][:-1])
    run("sample", take, "--points", points, "--out", tmp_path / "out.npz")
    sampled = np.load(tmp_path / "out.npz")
    free = ~values["fixed"]
    size, angle = field_errors(values["wind"], sampled["wind_velocity"], free)
    assert size < 15.0 and angle < 9.0
    volume = 0.8 * 0.5 * values["thickness"].item()
    weight = 0.8 * 0.5 * values["areal_density"].item() * np.linalg.norm(GRAVITY)
    net = np.linalg.norm(sampled["force_density"][:, free].mean(axis=1), axis=-1) * volume
    assert 0.2 * weight < np.median(net) < 5.0 * weight
    told = json.loads((take / "wind.json").read_text())
    assert told["unexplained_share"] < 0.2
    stamp = (take / "trajectory.npz").stat().st_mtime_ns
    again = run("recover-trajectories", file, "--take", take, "--report", "none")
    assert again["iterations"] == result["iterations"] and (take / "trajectory.npz").stat().st_mtime_ns == stamp
    assert len(np.load(take / "trajectory.npz")["x"]) == FRAMES + 1

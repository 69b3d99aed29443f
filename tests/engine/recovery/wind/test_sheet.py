"""The wind on a sheet that was seen in 3D: the balance of forces on it, its derivative, and what is recovered."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.trajectories.sheets import read_sheet
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.conventions import distrusted, front_view
from seeing_wind.engine.errors import ObjectError, SimulationError
from seeing_wind.engine.field import distillation, load_field
from seeing_wind.engine.look.report.accuracy import field_errors
from seeing_wind.engine.mpm.shell import shell_of
from seeing_wind.engine.progress import Journal, NoProgress
from seeing_wind.engine.records import Attachment, Camera, Measured, TrackTargets
from seeing_wind.engine.recovery.prior.basis import hats, spatial_basis
from seeing_wind.engine.recovery.wind.sheet import stage
from seeing_wind.engine.recovery.wind.sheet.air import Air, Push
from seeing_wind.engine.recovery.wind.sheet.balance import balance_of
from seeing_wind.engine.recovery.wind.sheet.estimate import BREEZE, SheetEstimate, field_of, follower_of
from seeing_wind.engine.recovery.wind.sheet.observed import observe_sheet
from seeing_wind.engine.recovery.wind.sheet.problem import SheetProblem, factor_of
from seeing_wind.engine.recovery.wind.sheet.tension import Tension
from seeing_wind.engine.settings import RecoverSettings, WindSettings
from seeing_wind.engine.take import Take
from tests.engine.recovery.wind.blown_sheet import FPS, FRAMES, GRAVITY, blown, mesh, quick_gusts


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("sheet") / "flag.npz"
    np.savez(path, **blown())
    return path


def followed(path, cause=Air):
    source, gravity, _ = read_sheet(path)
    seen = observe_sheet(source.x, source.faces, source.fixed, source.fps, 0.0)
    shell = shell_of(seen.rest, source.faces, source.sheet, pinned=source.fixed)
    return follower_of(shell, replace(seen, faces=shell.surface.faces), gravity, cause(shell))


def problem_of(follower):
    mass = follower.shell.mass * ~follower.shell.pinned
    balance = balance_of(follower.shell, follower.seen, follower.gravity)
    basis = spatial_basis(follower.seen.rest, mass, 3)
    return SheetProblem(balance, follower.cause, basis, hats(follower.seen.frames, 2.0), factor_of(balance, balance.seen))


@pytest.mark.parametrize("cause", [Air, Push])
def test_the_derivative_of_the_balance_by_the_unknowns(file, cause):
    problem = problem_of(followed(file, cause))
    rng = np.random.default_rng(0)
    count = 9 * problem.hats.shape[1] + 3
    theta, way = 0.3 * rng.normal(size=count), rng.normal(size=count)
    theta[-3:] = 1.0, 2.0, 0.5
    point = problem.linearise(theta)
    step = 1e-5
    numeric = (problem.residual(theta + step * way) - problem.residual(theta - step * way)) / (2.0 * step)
    np.testing.assert_allclose(way @ point.jacobian, numeric, atol=1e-6 * np.abs(numeric).max())
    np.testing.assert_allclose(point.residual, problem.residual(theta), atol=1e-12)


def test_a_sheet_that_falls_freely_feels_its_acceleration_and_nothing_else(file):
    """x = x0 + a t² / 2: the balance asks for the mass times a, less its weight, in every virtual displacement."""
    follower = followed(file, Push)
    pushed = np.array([1.0, -2.0, 0.5])
    time = np.arange(len(follower.seen.x)) / FPS
    x = follower.seen.rest + 0.5 * time[:, None, None] ** 2 * pushed
    problem = problem_of(replace(follower, seen=replace(follower.seen, x=x)))
    theta = np.zeros(9 * problem.hats.shape[1] + 3)
    theta[-3:] = pushed - GRAVITY
    np.testing.assert_allclose(problem.forces(theta), problem.balance.seen, atol=1e-6 * np.abs(problem.balance.seen).max())


def test_what_a_sheet_does_between_frames_is_known_where_it_is_smooth(file):
    """Two interpolations agree on a parabola; at a jerk in frame 8 they differ, and the forces there count less."""
    follower = followed(file)
    time = np.arange(len(follower.seen.x))[:, None, None] / FPS
    smooth = follower.seen.rest + 0.5 * time**2 * [3.0, -2.0, 1.0]
    jerk = smooth + np.where(time * FPS > 8, 0.02, 0.0) * (time - 8 / FPS) * FPS

    def uncertainty(x):
        problem = problem_of(replace(follower, seen=replace(follower.seen, x=x)))
        still = np.zeros(problem.unknowns)
        forces = problem.forces(still)
        return np.linalg.norm(problem.interpolation_error(still, forces), axis=1), forces

    known, forces = uncertainty(smooth)
    assert known[2:-2].max() < 1e-3 * np.linalg.norm(forces, axis=1).max()
    told = uncertainty(jerk)[0]
    assert abs(int(told.argmax()) - 7) <= 1 and told[2] < 0.01 * told.max()


def test_errors_that_are_no_covariance_are_refused(file):
    balance = problem_of(followed(file)).balance
    with pytest.raises(SimulationError, match="not positive definite"):
        factor_of(replace(balance, noise=balance.noise - 1e3 * np.eye(balance.noise.shape[1])), balance.seen)


def test_noise_of_the_points_is_that_of_their_second_differences(file):
    """Another in every frame: D N D' with the matrix D of the differences."""
    balance, rng = problem_of(followed(file)).balance, np.random.default_rng(4)
    count, data = balance.seen.shape
    parts = rng.normal(size=(count + 2, data, data))
    noise = 1e-4 * parts @ parts.swapaxes(1, 2)

    def covariance(given):
        factor = factor_of(replace(balance, noise=given), balance.seen)
        return factor @ factor.T

    found = (covariance(noise) - covariance(np.zeros_like(noise))).reshape(count, data, count, data)
    differences = np.diff(np.eye(count + 2), 2, axis=0)
    np.testing.assert_allclose(found, np.einsum("kt,mt,tde->kdme", differences, differences, noise), atol=1e-9 * np.abs(found).max())


def test_errors_that_vertices_share_push_the_whole_sheet(file):
    """A sheet that seems 1 mm too far along one axis: in each virtual displacement, what its whole mass weighs there."""
    follower = followed(file)
    shell, frames = follower.shell, len(follower.seen.x)
    shift = np.zeros((frames, 1, 3, 1, 3))
    shift[3, 0, 1, 0, 1] = 1e-6
    seen = replace(follower.seen, measured=Measured(follower.seen.x, np.ones((len(shell.mass), 1)), shift))
    balance = balance_of(shell, seen, follower.gravity)
    pushed = np.zeros((balance.tests.shape[1], 3))
    pushed[:, 1] = 1e-3 * shell.mass @ balance.tests * FPS**2
    np.testing.assert_allclose(balance.noise[3], np.outer(pushed, pushed), atol=1e-12 * (pushed**2).max())
    assert not balance.noise[[0, 1, 2, 4]].any()


def test_forces_of_a_stress_are_the_derivative_of_its_work(file):
    """Minus that of A S : F'F / 2, summed over the faces, for a stress of its own in every face."""
    shell = followed(file).shell
    rng = np.random.default_rng(2)
    tests = rng.normal(size=(len(shell.mass), 4))
    tension = Tension.of(shell, tests, 10.0)
    x = shell.surface.x + 0.02 * rng.normal(size=shell.surface.x.shape)
    root = rng.normal(size=(len(shell.surface.faces), 2, 2))
    stress = root + root.swapaxes(1, 2)

    def work(x):
        F = tension.gradients(x)
        return 0.5 * np.einsum("f,fab,fia,fib->", shell.surface.area, stress, F, F)

    forces = np.einsum("fia,fab,fqb->qi", tension.gradients(x), stress, tension.loads)
    step = 1e-5
    for mode, axis in ((0, 0), (1, 2), (3, 1)):
        way = tests[:, mode, None] * np.eye(3)[axis]
        assert forces[mode, axis] == pytest.approx((work(x - step * way) - work(x + step * way)) / (2.0 * step), rel=1e-6)


def test_a_wind_that_varies_is_found_from_noisy_points(file, tmp_path):
    noisy = tmp_path / "noisy.npz"
    np.savez(noisy, **blown(noise=5e-4))
    source, _, _ = read_sheet(noisy)
    truth, free = blown()["wind"], ~source.fixed
    found = field_of(followed(noisy), BREEZE, NoProgress())
    size, angle = field_errors(truth, found.velocity, free)
    steady = np.broadcast_to(truth[:, free].mean(axis=(0, 1)), truth.shape)
    flat_size, flat_angle = field_errors(truth, steady, free)
    assert size < 9.0 and angle < 6.0
    assert size < flat_size and angle < flat_angle
    error = np.abs(found.velocity - truth)[:, free]
    assert np.median(error / found.deviation[:, free]) < 3.0
    assert found.unexplained < 0.2


def test_quick_gusts_on_a_sheet_let_go_are_told(tmp_path):
    """They take a knot in every frame, and a law that is trusted as closely as the sheet keeps to it: neither is assumed."""
    scene = blown(held=False, air=quick_gusts)
    np.savez(tmp_path / "let_go.npz", **scene)
    found = field_of(followed(tmp_path / "let_go.npz"), BREEZE, NoProgress())
    everything = ~scene["fixed"]
    size, angle = field_errors(scene["wind"], found.velocity, everything)
    steady = np.broadcast_to(scene["wind"].mean(axis=(0, 1)), scene["wind"].shape)
    flat_size, flat_angle = field_errors(scene["wind"], steady, everything)
    assert size < 20.0 < flat_size and angle < 10.0 < flat_angle
    assert found.law < 0.05


def test_a_flat_sheet_stays_flat_at_rest_under_noise_and_a_bent_one_bent():
    x, faces = mesh()
    fixed = x[:, 0] < 1e-9
    noise = 5e-4 * np.random.default_rng(1).normal(size=(6, *x.shape))
    seen = observe_sheet(x + noise, faces, fixed, FPS, 5e-4)
    assert np.linalg.svd(seen.rest - seen.rest.mean(axis=0))[1][2] < 1e-9
    assert np.ptp(seen.pins, axis=0).max() == 0.0
    bent = x + np.array([0.0, 1.0, 0.0]) * (x[:, :1] ** 2)
    np.testing.assert_array_equal(observe_sheet(bent + 0.0 * noise, faces, fixed, FPS, 0.0).rest, bent)


def test_what_is_held_may_move():
    x, faces = mesh()
    fixed = x[:, 0] < 1e-9
    path = x + 0.01 * np.arange(8)[:, None, None] ** 2 * [0.0, 1.0, 0.0]
    seen = observe_sheet(path, faces, fixed, FPS, 0.0)
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
    monkeypatch.setattr(distillation, "ITERATIONS", 2)
    (take / "field.safetensors").write_text("damaged")
    run("recover-trajectories", file, "--take", take, "--report", "none")
    assert load_field(take / "field.safetensors").frames == FRAMES


@pytest.mark.parametrize("mixed_up", [False, True])
def test_a_sheet_that_was_not_followed_is_told_to_be_of_no_use(file, tmp_path, monkeypatch, mixed_up):
    """As a camera's tracks show, which are those of its vertices, or those of others."""
    monkeypatch.setattr(distillation, "ITERATIONS", 1)
    source, gravity, _ = read_sheet(file)
    x = source.x[:7]
    camera = Camera(480, 320, 480.0, 480.0, 239.5, 159.5, front_view(1.5))
    xy = np.stack([camera.project(one)[0] for one in x])
    if mixed_up:
        xy[1:] = xy[1:, ::-1]
    every = Attachment(np.arange(xy.shape[1], dtype=np.int32)[:, None], np.ones((xy.shape[1], 1)))
    tracks = TrackTargets(xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], 0.3), camera, every)
    seen = replace(source, x=x, targets=[tracks])
    found = stage.sheet_stage(Take(tmp_path), seen, "", RecoverSettings(gravity=gravity), WindSettings("force"), NoProgress())
    told = distrusted(found.recovery.notes)
    assert len(told) == mixed_up and all("The sheet that was followed is" in note for note in told)


def found_wind(cause, doubt, speed=4.0):
    """An estimate of a wind of `speed` [m/s] along x with a relative deviation of `doubt`; more probable than a force of its own."""
    velocity = np.broadcast_to([speed, 0.0, 0.0], (3, 5, 3))
    deviation, nothing = np.full(velocity.shape, doubt * speed / np.sqrt(3.0)), np.zeros(velocity.shape)
    evidence = 9.0 if cause == "wind" else 1.0
    return SheetEstimate(cause, velocity, deviation, velocity[0, 0], nothing, nothing, nothing, 0.1, evidence, 5, True, 0.05)


@pytest.mark.parametrize("doubt", [0.1, 0.3, 0.9])
def test_a_wind_that_a_sheet_does_not_tell_is_none(file, monkeypatch, doubt):
    """It is refused with a sentence, and `auto` takes the force; one that is known badly is told with a doubt."""
    follower = followed(file)
    kinds = {Air: "wind", Push: "force"}
    monkeypatch.setattr(stage, "field_of", lambda follower, *_, **__: found_wind(kinds[type(follower.cause)], doubt))

    def choose(field):
        return stage.choose(follower.shell, follower.seen, GRAVITY, field, NoProgress(), Journal())[1]

    if doubt > stage.UNTOLD:
        with pytest.raises(ObjectError, match="does not tell the wind: 90 %"):
            choose("wind")
        told = choose("auto")
        assert told["field"] == "force" and "does not tell the wind" in told["notes"][-1]
        return
    for field in ("wind", "auto"):
        told = choose(field)
        assert told["field"] == "wind" and told["doubt"] == pytest.approx(doubt)
        assert any("doubtful: 30 %" in note for note in told["notes"]) == (doubt > stage.DOUBTFUL)


def test_a_sheet_may_tell_that_the_air_is_calm(file, monkeypatch):
    """0.3 m/s give or take 0.27: nobody feels more."""
    follower = followed(file)
    monkeypatch.setattr(stage, "field_of", lambda *_, **__: found_wind("wind", 0.9, 0.3))
    told = stage.choose(follower.shell, follower.seen, GRAVITY, "wind", NoProgress(), Journal())[1]
    assert told["field"] == "wind" and any("doubtful: 90 % of its speed, 0.3 m/s" in note for note in told["notes"])

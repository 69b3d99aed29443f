"""One wind from several bodies: what one body does not determine, another does; and the verb that writes it into the takes."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.field import distillation, load_field
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Outcome, Recovery
from seeing_wind.engine.recovery.prior.basis import spatial_basis
from seeing_wind.engine.recovery.wind.estimate import wind_of
from seeing_wind.engine.recovery.wind.felt import felt_force
from seeing_wind.engine.recovery.wind.surface import particle_surface
from seeing_wind.engine.recovery.wind.together import FeltTogether, basis_together
from tests.engine.recovery.wind.blown_plate import DENSITY, FPS, plate_particles

FRAMES, SIDES = 12, (0.2, 0.16, 0.02)
NOISE = 2.0
"""Noise [m/s²] of the recovered accelerations; the wind on the narrow sides causes accelerations of about this size."""
MEAN, GUST = np.array([4.0, 3.0, 0.5]), np.array([1.0, -1.5, 0.5])


def wind_at(t: np.ndarray) -> np.ndarray:
    """(T, 3) [m/s]: the same everywhere."""
    return MEAN + np.sin(2.0 * np.pi * t / 0.4)[:, None] * GUST


def blown(seed: int, centre: tuple[float, float, float], normal_to: np.ndarray):
    """A plate that stands in the wind and feels it on its six sides, as a recovery would have it: felt, basis, particles, path."""
    turn = Rotation.align_vectors([normal_to], [[0.0, 0.0, 1.0]])[0].as_matrix()
    particles = plate_particles()
    particles = replace(particles, x=particles.x @ turn.T + np.array(centre))
    wind = wind_at((np.arange(FRAMES) + 0.5) / FPS)
    force = np.zeros((FRAMES, 3))
    for axis, area in enumerate(np.prod(SIDES) / np.array(SIDES)):
        normal = turn[:, axis]
        across = (wind @ normal)[:, None] * normal
        force += 0.6 * area * np.linalg.norm(wind, axis=1)[:, None] * (1.17 * across + 0.05 * (wind - across))
    force += NOISE * DENSITY * np.prod(SIDES) * np.random.default_rng(seed).standard_normal(force.shape)
    density = np.repeat(force[:, None] / np.prod(SIDES), len(particles.x), axis=1)
    path = np.repeat(particles.x[None], FRAMES + 1, axis=0)
    still = np.tile(np.eye(3), (FRAMES + 1, len(particles.x), 1, 1))
    deviation = np.full(density.shape, np.sqrt(3.0) * NOISE * DENSITY)
    recovery = Recovery(
        Outcome.CONVERGED, density, deviation, path, still, np.zeros_like(particles.x), np.zeros(FRAMES + 1), "m", 1, 1.0
    )
    basis = spatial_basis(particles.x, particles.volume, 16).up_to(1)
    return felt_force(recovery, particles, DENSITY, particle_surface(particles), basis, FPS), basis, particles, path


def off(velocity: np.ndarray) -> float:
    """Mean size of the error of `velocity` (T, N, 3) [m/s], relative to the wind's mean size."""
    true = wind_at((np.arange(FRAMES) + 0.5) / FPS)[:, None]
    return float(np.linalg.norm(velocity - true, axis=-1).mean() / np.linalg.norm(true, axis=-1).mean())


@pytest.fixture(scope="module")
def pair():
    return blown(0, (0.0, 0.0, 0.0), np.array([1.0, 0.0, 0.0])), blown(1, (0.3, 0.1, 0.0), np.array([0.0, 1.0, 0.0]))


def joint(pair):
    felts, bases, bodies, paths = zip(*pair)
    union = basis_together(bases, [one.x for one in bodies])
    return FeltTogether(felts), union, np.concatenate(paths, axis=1), [len(one.x) for one in bodies]


def test_two_plates_tell_each_other_what_neither_feels(pair):
    alone = [off(wind_of(felt, basis, path).velocity) for felt, basis, _, path in pair]
    felt, union, path, counts = joint(pair)
    together = wind_of(felt, union, path, counts=counts)
    assert off(together.velocity) < 0.6 * min(alone), (alone, off(together.velocity))
    assert off(together.velocity) < off(np.broadcast_to(MEAN, together.velocity.shape))  # the best steady wind


def test_a_body_feels_the_wind_on_itself_only(pair):
    felt, _, _, _ = joint(pair)
    wind = np.random.default_rng(0).normal(size=(FRAMES, felt.modes, 3)) + [0.0, 0.0, 6.0]
    slopes, change = felt.slopes(wind), np.zeros_like(wind)
    first = felt.uniform_modes[1]
    change[:, first, 0] = 1e-6
    quotient = (felt.predicted(wind + change) - felt.predicted(wind - change)) / 2e-6
    np.testing.assert_allclose(slopes[:, :, first, 0], quotient, rtol=1e-4, atol=1e-5 * np.abs(slopes).max())
    assert not slopes[:, : pair[0][0].measured.shape[1], first].any()


def run(*words):
    arguments = parser().parse_args([str(word) for word in words])
    return VERBS[arguments.verb](arguments, NoProgress())


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """Two squares that the wind carries off, recovered from one clip; the folder of both."""
    home = tmp_path_factory.mktemp("objects")
    writer = cv2.VideoWriter(str(home / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (128, 64))
    for t in range(8):
        frame = np.full((64, 128, 3), 90, np.uint8)
        for left in (10, 80):
            along = left + round(0.25 * t**2)
            frame[20:40, along : along + 20] = np.random.default_rng(left).integers(150, 255, (20, 20, 1), np.uint8)
        writer.write(frame)
    writer.release()
    listed = []
    for name, left in (("one", 10), ("two", 80)):
        mask = np.zeros((64, 128), np.uint8)
        mask[20:40, left : left + 20] = 255
        cv2.imwrite(str(home / f"{name}.png"), mask)
        numbers = {"density": 100.0, "youngs_modulus": 1e4, "poisson_ratio": 0.3}
        numbers |= dict.fromkeys(("yield_stress", "viscosity", "thickness"))
        listed.append({"name": name, "object": name, "material": "leaf", "mask": str(home / f"{name}.png"), "law": "neo_hookean"} | numbers)
    (home / "objects.json").write_text(json.dumps({"objects": listed}))
    quick = ("--distance", 1, "--iterations", 1, "--particles", 60, "--no-gravity", "--report", "none", "--representation", "point")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distillation, "ITERATIONS", 60)
        result = run("recover", home / "clip.avi", "--take", home / "takes", "--objects", home / "objects.json", "--field", "wind", *quick)
    return home, result


def test_objects_of_a_clip_share_their_wind(objects):
    home, result = objects
    assert not any("of its own" in warning for warning in result["warnings"]), result["warnings"]
    told = [json.loads((home / "takes" / f"{name}.take" / "wind.json").read_text()) for name in ("one", "two")]
    assert told[0] == told[1] and told[0]["joined"] == ["one.take", "two.take"]
    fields = [load_field(home / "takes" / f"{name}.take" / "wind.safetensors") for name in ("one", "two")]
    assert all(field.kind == "wind" for field in fields)
    where = np.array([[0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(fields[0].sample(where, 3)[0], fields[1].sample(where, 3)[0])


def test_what_cannot_be_joined_is_told_and_nothing_is_lost(objects, tmp_path):
    home, _ = objects
    one, two = home / "takes" / "one.take", home / "takes" / "two.take"
    before = (one / "wind.safetensors").read_bytes()
    with pytest.raises(UsageError, match="two different takes"):
        run("join", one, one)
    with pytest.raises(UsageError, match="holds no recovered field"):
        run("join", one, tmp_path)
    short = tmp_path / "short.take"
    words = ("--take", short, "--mask", home / "two.png", "--distance", 1, "--iterations", 1, "--particles", 60, "--no-gravity")
    run("recover", home / "clip.avi", *words, "--frames", "0:5", "--report", "none", "--representation", "point")
    with pytest.raises(UsageError, match="has 5 frames"):
        run("join", one, short)
    assert (one / "wind.safetensors").read_bytes() == before
    assert run("join", two, one)["wind"]["joined"] == ["two.take", "one.take"]

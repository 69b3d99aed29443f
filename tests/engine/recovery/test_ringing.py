"""Frames in which a held body swings freely: damped oscillators in closed form, pushed and let go."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.records import Attachment, Camera, PointTargets, TrackTargets
from seeing_wind.engine.recovery.diagnostics.remarks import ringing_remarks
from seeing_wind.engine.recovery.targets.ringing import alone

FPS, FRAMES, POINTS = 30.0, 120, 12
ATTACHMENT = Attachment(np.arange(POINTS)[:, None], np.ones((POINTS, 1)))


def swing(force: np.ndarray, frequency: float = 2.0, damping: float = 0.01) -> np.ndarray:
    """Displacement (T+1,) of an oscillator that starts at rest, under accelerations `force` (T,) that are constant in each frame."""
    w = 2.0 * np.pi * frequency
    step = expm(np.array([[0.0, 1.0, 0.0], [-(w**2), -2.0 * damping * w, 1.0], [0.0, 0.0, 0.0]]) / FPS)
    state = np.zeros((len(force) + 1, 2))
    for t, push in enumerate(force):
        state[t + 1] = (step @ [*state[t], push])[:2]
    return state[:, 0]


def post(across: np.ndarray, along: np.ndarray | None = None, noise: float = 1e-6) -> PointTargets:
    """Points along a post whose top is displaced by `across` and `along` (T+1,) [m], with errors of size `noise` [m]."""
    up = np.linspace(0.1, 1.0, POINTS)
    x = np.zeros((len(across), POINTS, 3))
    x[..., 0], x[..., 2] = across[:, None] * up**2, up
    if along is not None:
        x[..., 1] = along[:, None] * up**2
    return PointTargets(x + noise * np.random.default_rng(0).standard_normal(x.shape), np.ones(x.shape[:2], bool), ATTACHMENT)


def gusts(seed: int, seconds: float) -> np.ndarray:
    """Random accelerations (2, T) [m/s²] with a correlation time of `seconds`."""
    kept = np.exp(-1.0 / (FPS * seconds))
    wind, random = np.zeros((2, FRAMES)), np.random.default_rng(seed)
    for t in range(1, FRAMES):
        wind[:, t] = kept * wind[:, t - 1] + np.sqrt(1.0 - kept**2) * random.standard_normal(2)
    return wind


def blow(at: int) -> np.ndarray:
    force = np.zeros(FRAMES)
    force[at : at + 2] = 8.0
    return force


def test_a_struck_post_swings_by_itself_from_the_frame_after_the_blow():
    for damping in (0.01, 0.05):
        found = alone([post(swing(blow(5), damping=damping))])
        assert not found[2:7].any() and found[7:].all()
    both = post(swing(blow(5)), swing(0.7 * blow(5), 2.2))
    assert not alone([both])[2:7].any() and alone([both])[7:].all()
    noisy = alone([post(swing(blow(5)), noise=5e-5)])
    assert noisy[7:80].all() and not noisy[2:7].any()
    notes = ringing_remarks(alone([both]))
    assert len(notes) == 1 and "From frame 7 to frame 119" in notes[0] and "--ringing ignored" in notes[0]


def test_air_that_comes_to_rest_later():
    wind = gusts(3, 0.3)[0]
    wind[60:] = 0.0
    found = alone([post(swing(wind))])
    assert found[60:].all() and not found[:58].any()


@pytest.mark.parametrize("seconds", [0.1, 0.3, 1.0])
def test_gusts_are_no_still_air(seconds):
    for seed in range(8):
        wind = gusts(seed, seconds) + 0.5 * (seed % 3)
        assert not alone([post(swing(wind[0]), swing(wind[1], 2.2))]).any()
        assert not alone([post(swing(wind[0]))]).any()


def test_what_does_not_die_away_or_lasts_less_than_two_swings_is_no_still_air():
    steady = 0.02 * np.sin(2.0 * np.pi * 1.3 * np.arange(FRAMES + 1) / FPS)
    assert not alone([post(steady)]).any()
    assert not alone([post(swing(blow(5), 0.45))]).any()
    assert not alone([post(np.zeros(FRAMES + 1), noise=1e-4)]).any()


def test_all_views_that_say_anything_must_agree():
    seen, blown = post(swing(blow(5))), post(swing(gusts(1, 0.3)[0]))
    hidden = PointTargets(seen.x, np.zeros_like(seen.visible), ATTACHMENT)
    assert alone([seen, hidden])[7:].all() and not alone([seen, blown]).any() and not alone([hidden]).any()


def test_tracks_of_a_camera_tell_it_too():
    seen = post(swing(blow(5)))
    camera = Camera(640, 480, 500.0, 500.0, 319.5, 239.5, front_view(3.0))
    xy = np.stack([camera.project(x)[0] for x in seen.x]) + 0.02 * np.random.default_rng(1).standard_normal((FRAMES + 1, POINTS, 2))
    tracks = TrackTargets(xy, seen.visible, np.full(seen.visible.shape, 0.1), camera, ATTACHMENT)
    found = alone([tracks])
    assert not found[2:7].any() and found[7:60].all()

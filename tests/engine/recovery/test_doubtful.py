"""What a recovery says of a force that does not explain what was seen, or that may be no wind."""

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.conventions import UNHELD, distrusted
from seeing_wind.engine.errors import ObjectError
from seeing_wind.engine.field.confidence import confidence_map
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.records import TrackTargets
from seeing_wind.engine.recovery.diagnostics.missed import far_off, free_fall, verdict
from seeing_wind.engine.recovery.diagnostics.remarks import worst_first
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.targets.objective import Objective
from seeing_wind.engine.recovery.targets.points import point_channels
from seeing_wind.engine.recovery.targets.tracks import track_channels
from seeing_wind.engine.settings import RecoverSettings
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, camera, every, plate, points, relative


def test_a_sudden_change_of_the_force_is_named():
    body = plate((3, 3, 2))
    x, wind = blow(body, lambda X, t: np.zeros_like(X) + [3.0 if t < 10 else -3.0, 0.0, 0.0], 20)
    found = recover(body, RUBBER, points(body, x), FPS, WEIGHTLESS, NoProgress())
    assert relative(found.force_density[[3, 4, 15, 16]], RUBBER.density * wind[[3, 4, 15, 16]]) < 0.2
    assert any(f"frame {frame} " in note for note in found.notes for frame in (9, 10, 11))
    assert found.deviation[9:11].min() > 2.0 * found.deviation[[2, 3, 16, 17]].max()  # and not known there


def test_motion_that_no_force_explains_is_no_result():
    body = plate((3, 3, 2))
    x = body.x + 0.1 * np.random.default_rng(0).standard_normal((10, 1, 1)) * np.sign(body.x[:, :1]) * [1.0, 0.0, 0.0]
    x[0] = body.x  # the halves jump apart and together, through each other
    with pytest.raises(ObjectError, match="no force explains this motion"):
        recover(body, RUBBER, points(body, x), FPS, WEIGHTLESS, NoProgress())


@pytest.mark.parametrize("unit", ["px", "m"])
def test_the_residual_told_on_the_way_is_the_one_reported_at_the_end(unit):
    """Else a user who watches 0.3 deviations reads 2 px in the report."""
    body, told = plate((6, 2, 4)), []
    x, _ = blow(body, lambda X, t: np.zeros_like(X) + [3.0 * np.cos(0.8 * t), 0.0, 2.0], 10)
    targets = points(body, x) if unit == "m" else [seen_in_pixels(body, x).targets]
    found = recover(body, RUBBER, targets, FPS, WEIGHTLESS, Progress(told.append))
    last = [message for message in told if "residual" in message][-1]
    assert last["residual_unit"] == found.residual_unit == unit
    assert last["residual"] == pytest.approx(np.median(found.residual[1:]), rel=0.3)


def seen_in_pixels(body, x, sigma=0.1):
    xy = np.stack([camera().project(one)[0] for one in x])
    return track_channels(body, TrackTargets(xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], sigma), camera(), every(body)), False)


def test_a_body_that_stays_off_what_was_seen_is_not_to_be_trusted():
    body = plate((20, 2, 20))  # 250 px across
    x = np.stack([body.x + [0.1 * t, 0.0, 0.0] for t in range(9)])
    channels, off = [seen_in_pixels(body, x)], np.full(9, 4.0)
    assert far_off(body, channels, x, off) == []
    notes = far_off(body, channels, x, 4.0 * off)
    assert "16 pixels (median)" in notes[0] and distrusted(["else", *notes]) == notes


@pytest.mark.parametrize("pixels", [True, False])
def test_what_is_missed_is_compared_with_the_motion_that_a_force_has_to_explain(pixels):
    """A third of a swing that ends 20 px from its start is 2 px in the mean, less than what points may be off that go as far."""
    body = plate((20, 2, 20), pinned=lambda X: X[:, 2] < -0.18)
    time, height = np.arange(14)[:, None], (body.x[:, 2] - body.x[:, 2].min()) / 0.38

    def swung(most: float) -> np.ndarray:
        return body.x + (most * np.sin(0.12 * time) * height**2)[..., None] * [1.0, 0.0, 0.0]

    def told(found: np.ndarray, seen: np.ndarray, fall: np.ndarray | None = None) -> list[str]:
        channels = [seen_in_pixels(body, seen, sigma=0.3) if pixels else point_channels(body, points(body, seen), False)]
        return far_off(body, channels, found, Objective(channels).root_mean_square(found), fall)

    (note,) = told(swung(0.66 * 0.042), swung(0.042))
    assert "of the motion that a force has to explain" in note and distrusted([note]) == [note]
    assert told(swung(0.95 * 0.042), swung(0.042)) == []
    falling = free_fall(body.x, np.array([0.0, 0.0, 1.0]), (0.0, 0.0, -9.81), 13, FPS)
    blown = falling + 0.5 * 0.3 * (time / FPS)[..., None] ** 2 * [1.0, 0.0, 0.0]
    assert told(falling, blown) == [] and told(falling, blown, falling), "it falls 0.5 m, and the wind moves it by 0.03 m"
    assert told(blown + 0.05 * (blown - falling), blown, falling) == []


def test_noise_of_points_that_nobody_stated_is_not_missed_motion():
    body = plate((4, 4, 3))
    x = np.stack([body.x + [0.002 * t**2, 0.0, 0.0] for t in range(12)])
    noisy = x + 0.02 * np.random.default_rng(0).standard_normal(x.shape)
    noisy[0] = body.x
    channels = [point_channels(body, points(body, noisy), False)]
    assert far_off(body, channels, x, Objective(channels).root_mean_square(x)) == []


def test_points_that_are_missed_by_their_stated_errors_alone_are_explained():
    body = plate((4, 4, 3))
    x, _ = blow(body, lambda X, t: np.zeros_like(X) + [3.0, 0.0, 0.0], 8)
    x[1:] += 0.01 * np.random.default_rng(0).standard_normal(x[1:].shape)

    def said(sigma):
        return distrusted(recover(body, RUBBER, replace(points(body, x), sigma=sigma), FPS, WEIGHTLESS, NoProgress()).notes)

    assert said(0.002) and not said(0.01)


def test_tracks_that_are_missed_by_much_of_their_way_are_told():
    body = plate((20, 2, 20))  # 250 px across

    def told(way: float, off: float, share: float = 1.0) -> list[str]:
        x = np.stack([body.x + [way * t / 8, 0.0, 0.0] for t in range(9)])
        seen = seen_in_pixels(body, x)
        seen.targets.xy[1:, : round(share * len(body.x)), 0] += off
        return far_off(body, [seen], x, Objective([seen]).root_mean_square(x))

    assert told(way=0.1, off=2.0) == [] and told(way=0.02, off=0.9) == [] and told(way=0.02, off=3.0, share=0.3) == []
    (note,) = told(way=0.02, off=2.0)
    assert "of the motion that a force has to explain" in note and distrusted([note]) == [note]
    assert told(way=0.002, off=2.0) == [], "of a body that stays there is another note"


def test_a_free_body_that_is_followed_only_roughly_is_told_first():
    """Like a flower whose head was seen to shear: 4.6 px off, hardly a hundredth of its size, and not quite a tenth of its motion."""
    body = plate((20, 2, 20))  # 250 px across

    def told(off: float, way: float = 0.15) -> list[str]:
        x = np.stack([body.x + [way * t / 8, 0.0, 0.0] for t in range(9)])
        seen = seen_in_pixels(body, x)
        seen.targets.xy[1:, :, 0] += off
        return verdict(body, [seen], x, Objective([seen]).root_mean_square(x))

    (note,) = told(off=4.6)
    assert note.startswith("The simulated body is 4.6 pixels (median) from where it was seen, 8 % of the motion")
    assert not distrusted([note]), "it is of some use"
    assert worst_first(["a wind", f"{UNHELD}; it may be the weight.", note])[0] == note
    assert told(off=0.9) == [] and told(off=1.5) == [], "as of a clip that is recovered"
    (worse,) = told(off=9.0)
    assert distrusted([worse]) == [worse] and worst_first([note, worse])[0] == worse


def test_pins_on_what_moves_in_the_clip_are_named():
    body = plate((3, 3, 8), pinned=lambda X: X[:, 2] < -0.05)
    x, _ = blow(body, lambda X, t: np.zeros_like(X) + [2.0, 0.0, 0.0], 8)

    def notes(pinned):
        xy = np.stack([camera().project(frame, t)[0] for t, frame in enumerate(x)])
        tracks = TrackTargets(xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], 0.1), camera(), every(body))
        return recover(replace(body, pinned=pinned), RUBBER, [tracks], FPS, WEIGHTLESS, NoProgress()).notes

    assert not any("What is held moves" in note for note in notes(body.pinned))
    assert any("What is held moves by" in note and "--pin" in note for note in notes(body.x[:, 2] > 0.05))


def test_a_body_that_does_not_move_is_held_up_by_the_force_against_gravity():
    body = plate((4, 4, 3))
    still = np.repeat(body.x[None], 6, axis=0)
    found = recover(body, RUBBER, points(body, still), FPS, RecoverSettings(), NoProgress())
    np.testing.assert_allclose(found.force_density.mean(axis=(0, 1)), [0.0, 0.0, 400.0 * 9.81], atol=60.0)
    assert any("hardly moves" in note for note in found.notes)
    assert "Nothing was marked as held" in found.notes[0] and "may be only what holds the body up" in found.notes[0]
    assert confidence_map(found, body).value.max() < 0.3, "nobody is told that this is a wind"


def test_a_body_in_a_draught_that_carries_it_away_is_not_said_to_be_held_up():
    body = plate((4, 4, 3))
    drifting = body.x + np.arange(9)[:, None, None] / FPS * np.array([1.0, 0.0, 0.0])
    found = recover(body, RUBBER, points(body, drifting), FPS, RecoverSettings(), NoProgress())
    assert not any("marked as held" in note for note in found.notes)


def test_a_body_that_nothing_moves_says_so():
    body, t = plate((4, 4, 3)), np.arange(9)[:, None, None] / FPS
    thrown = body.x + t * np.array([1.0, 0.0, 0.5])
    falling = thrown + 0.5 * t**2 * np.array([0.0, 0.0, -9.81])

    def notes(x, settings):
        return [note for note in recover(body, RUBBER, points(body, x), FPS, settings, NoProgress()).notes if "as if" in note]

    assert "no force" in notes(thrown, WEIGHTLESS)[0]
    assert "only the given gravity" in notes(falling, RecoverSettings())[0]
    assert not notes(falling, WEIGHTLESS)

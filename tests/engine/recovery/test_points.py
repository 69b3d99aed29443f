"""Points in 3D that slip, that are less certain along one axis, or that make no sense."""

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.errors import ObjectError, SeeingWindError, UsageError
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.blocks import blocks
from seeing_wind.engine.recovery.diagnostics.posterior import missed_acceleration
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.targets.points import point_channels
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, plate, points, relative


def wind(X, t):
    return np.array([2.0, 0.0, 1.0 + 0.1 * t]) + X @ np.array([[0.0, 5.0, 10.0], [0.0, 0.0, 8.0], [0.0, 0.0, 0.0]])


def test_points_that_slip_and_stay_leave_force_and_deviation_as_they_were():
    body = plate((6, 5, 3))
    x, force = blow(body, wind, 12)
    slipped = x.copy()
    slipped[5:, ::10] += [0.05, 0.0, 0.0]
    good, found = (recover(body, RUBBER, points(body, seen), FPS, WEIGHTLESS, NoProgress()) for seen in (x, slipped))
    assert relative(found.force_density, 400.0 * force) < 1.2 * relative(good.force_density, 400.0 * force) + 0.02
    assert np.median(found.deviation / good.deviation) < 2.0 and (found.deviation / good.deviation).max() < 5.0
    assert found.residual.max() < 1e-3  # of those that are followed
    assert [note for note in found.notes if "9 of 90 points" in note and "left out" in note] and not good.notes


def test_exact_points_of_which_half_are_hidden_in_a_frame_stay_exact():
    body = plate((6, 5, 3))
    x, force = blow(body, wind, 9)
    hidden = points(body, x)
    visible = hidden.visible.copy()
    visible[3, body.x[:, 0] > 0.0] = False
    whole, part = (recover(body, RUBBER, each, FPS, WEIGHTLESS, NoProgress()) for each in (hidden, replace(hidden, visible=visible)))
    assert relative(part.force_density, 400.0 * force) < 1.3 * relative(whole.force_density, 400.0 * force) + 0.01


def test_frames_in_which_nothing_is_seen_are_named():
    body = plate((6, 5, 3))
    x, _ = blow(body, wind, 9)
    seen = points(body, x)
    visible = seen.visible.copy()
    visible[[4, 8, 9]] = False
    found = recover(body, RUBBER, replace(seen, visible=visible), FPS, WEIGHTLESS, NoProgress())
    told = [note for note in found.notes if note.startswith("Nothing of the object is seen")]
    assert len(told) == 2 and "in frame 4:" in told[0] and "from frame 8 to frame 9:" in told[1]


def test_what_is_left_out_is_not_missed():
    body = plate((6, 5, 3))
    x, _ = blow(body, wind, 8)
    slipped = x.copy()
    slipped[4:, 7] += [0.0, 0.2, 0.0]
    channels = point_channels(body, points(body, slipped), False)
    assert channels.wild[4:, 7].all() and channels.wild.sum() == 5
    assert missed_acceleration(points(body, slipped), x, FPS).max() > 1.0
    assert missed_acceleration(channels.targets, x, FPS).max() < 1e-6


def test_a_held_body_may_stray_slowly():
    """As one whose clamp gives way. The squared distance of a shift by 5 % of the motion, in the deviations assumed of the mismatch."""
    body, time = plate((6, 5, 3), pinned=lambda x: x[:, 0] < -0.03), np.arange(91)
    swing = np.sin(time / 4.0)[:, None] * np.clip(body.x[:, 0] + 0.03, 0.0, None) ** 2
    x = body.x + 5.0 * swing[..., None] * [0.0, 0.0, 1.0]
    channels = point_channels(body, points(body, x), False)
    size = np.sqrt((channels.observed[:, 0] - channels.observed[0, 0]).var())
    cost = {}
    for how, shape in (("slow", time / 90.0), ("quick", np.sin(2.0 * time))):
        shift = 0.05 * size * shape[1:]
        cost[how] = shift @ np.linalg.solve(channels.covariance(2)[1:, 1:], shift)
    assert cost["slow"] < 4.0 < 40.0 < cost["quick"]


TURN = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [0.5, 1.0, 0.0], [0.4, 0.1, 1.0]]))[0]
"""Axes (columns) of a body that lies askew to the world's; it is held at its end towards -TURN[:, 0] and bends towards TURN[:, 2]."""
CLAMP = -0.255


def bent(straight, curvature, stretch=0.0):
    """Positions (T+1, N, 3) of a body bent from its clamp on to circles of `curvature` (T+1,) [1/m], its sections perpendicular to them."""
    along = np.clip(straight.x[:, 0] - CLAMP, 0.0, None)
    k, s = np.asarray(curvature)[:, None] + 1e-9, (1.0 + stretch) * along
    held = np.minimum(straight.x[:, 0], CLAMP)
    axial = held + np.sin(k * s) / k - straight.x[:, 2] * np.sin(k * s)
    across = (1.0 - np.cos(k * s)) / k + straight.x[:, 2] * np.cos(k * s)
    return np.stack([axial, np.broadcast_to(straight.x[:, 1], axial.shape), across], axis=-1) @ TURN.T


@pytest.fixture(scope="module")
def post():
    return plate((31, 3, 3), pinned=lambda x: x[:, 0] < CLAMP)


def test_bending_does_not_move_a_point_along_its_body_and_stretching_does(post):
    body, curvature = replace(post, x=post.x @ TURN.T), 1.5 * np.sin(np.arange(31) / 5.0)
    channels = point_channels(body, points(body, bent(post, curvature)), False)
    assert channels.curve is not None and abs(channels.frame[:, 0] @ TURN[:, 0]) > 0.9999
    shortening = np.abs(((channels.observed - channels.observed[0]) @ TURN)[..., 0]).max()
    assert np.abs(channels.curve.observed - channels.curve.observed[0]).max() < 0.03 * shortening

    def seen(**other):
        """Of another motion less this one, in frame 8, where it is bent most: all in common along the curve, and its stretch."""
        return channels.residual(bent(post, **other)[8:9], 8).reshape(-1, 3)[:2, 0]

    length = post.x[:, 0].max() - CLAMP
    stretched, wrongly_bent = seen(curvature=curvature, stretch=0.001), seen(curvature=1.02 * curvature)
    assert np.linalg.norm(stretched) > 0.3 * 0.001 * length
    assert np.abs(wrongly_bent).max() < 0.05 * np.abs(stretched).max(), "of a bending that is off by 2 %, next to nothing is seen"


def test_noise_does_not_look_like_a_stretch(post):
    """Points with independent errors in every frame, of which those of frame 0 make the body, and stay with it as it bends."""
    curvature, noise, random = 1.5 * np.sin(np.arange(31) / 5.0), 8e-4, np.random.default_rng(0)
    told = np.empty((6, 30))
    for one in told:
        error = noise * random.standard_normal((31, *post.x.shape))
        seen = bent(post, curvature) + error @ TURN.T
        channels = point_channels(replace(post, x=seen[0]), points(replace(post, x=seen[0]), seen), False)
        built = bent(replace(post, x=post.x + error[0]), curvature)
        one[:] = [channels.residual(built[t : t + 1], t).reshape(-1, 3)[1, 0] for t in range(1, 31)]
    of_an_amplitude = noise / np.sqrt(len(post.x))
    assert abs(told.mean()) < 0.7 * of_an_amplitude, "errors are as often to the one side as to the other"
    assert told.std(axis=1).mean() < 1.15 * of_an_amplitude


def test_points_that_are_not_always_seen_leave_the_rest_to_tell_the_curve(post):
    body, curvature = replace(post, x=post.x @ TURN.T), 1.5 * np.sin(np.arange(31) / 5.0)
    seen = points(body, bent(post, curvature))
    visible = seen.visible.copy()
    visible[4:9, ::7] = False
    some = point_channels(body, replace(seen, visible=visible, x=np.where(visible[..., None], seen.x, np.nan)), False)
    moved, across = (np.abs(one - one[0]).max() for one in (some.curve.observed, some.observed))
    assert moved < 0.01 * across
    visible[4:9] = False
    assert point_channels(body, replace(seen, visible=visible), False).curve is None


def test_what_a_held_body_does_along_its_curve_is_believed_unless_all_of_it_does_so_in_step_with_its_swing(post):
    """The squared distance of motions by 1 % of the swing, in the deviations assumed of the mismatch."""
    body, time = replace(post, x=post.x @ TURN.T), np.arange(61)
    channels = point_channels(body, points(body, bent(post, 1.5 * np.sin(time / 5.0))), False)
    moved = (channels.observed[:, 0] - channels.observed[0, 0]) @ channels.frame[:, 1:]
    size = np.sqrt(moved.var(axis=0).sum())
    swing, other = moved[:, moved.var(axis=0).argmax()] / size, np.sin(time / 2.0)
    cost = {}
    for how, channel, shape in (("in step", 0, swing), ("along", 0, other), ("stretch in step", 3, swing), ("across", 2, other)):
        motion = 0.01 * size * shape[1:]
        cost[how] = motion @ np.linalg.solve(channels.covariance(channel)[1:, 1:], motion)
    assert cost["in step"] < 4.0 and min(cost["along"], cost["stretch in step"]) > 10.0 * max(cost["across"], cost["in step"])



def test_a_clamp_may_tilt_slowly_and_the_sections_with_it(post):
    """The squared distance of sections that turn by 0.8 % of the swing, in the deviations assumed of the mismatch."""
    body, time = replace(post, x=post.x @ TURN.T), np.arange(91)
    channels = point_channels(body, points(body, bent(post, 1.5 * np.sin(time / 5.0))), False)
    turned = 3 * int(np.flatnonzero(~channels.curve.lengthwise.modes)[0])
    size = np.sqrt(((channels.observed[:, 0] - channels.observed[0, 0]) ** 2).mean())
    cost = {}
    for how, shape in (("slow", time / 90.0), ("quick", np.sin(2.0 * time))):
        shift = 0.008 * size * shape[1:]
        cost[how] = shift @ np.linalg.solve(channels.covariance(turned)[1:, 1:], shift)
    assert cost["slow"] < 4.0 < 40.0 < cost["quick"]


def test_depth_that_is_seen_less_well_counts_less():
    """Along an axis askew to the world's, noise a hundred times that across; told by a covariance, the force across stays good."""
    body, rng = plate((8, 5, 3)), np.random.default_rng(1)
    x, force = blow(body, lambda X, t: np.array([2.0, -1.0, 1.5]) + 6.0 * X[:, [1, 2, 0]], 12)
    along = np.array([1.0, 1.0, 0.5]) / 1.5
    shaken = x + 1e-5 * rng.normal(size=x.shape)
    shaken[1:] += 3e-3 * rng.normal(size=(*x[1:].shape[:2], 1)) * along
    covariance = np.tile(1e-5**2 * np.eye(3) + 3e-3**2 * np.outer(along, along), (len(body.x), 1, 1))
    across = np.eye(3) - np.outer(along, along)

    def error(targets):
        found = recover(body, RUBBER, targets, FPS, WEIGHTLESS, NoProgress())
        return relative(found.force_density @ across, 400.0 * force @ across)

    plain = points(body, shaken)
    told = error(replace(plain, covariance=covariance))
    assert told < 0.5 * error(plain)
    assert told < 0.06


def test_a_round_covariance_is_a_sigma():
    body, rng = plate((6, 4, 3)), np.random.default_rng(0)
    x, _ = blow(body, wind, 8)
    seen = points(body, x + 2e-4 * rng.normal(size=x.shape))
    one = recover(body, RUBBER, replace(seen, sigma=2e-4), FPS, WEIGHTLESS, NoProgress())
    same = replace(seen, covariance=np.tile(2e-4**2 * np.eye(3), (len(body.x), 1, 1)))
    other = recover(body, RUBBER, same, FPS, WEIGHTLESS, NoProgress())
    assert relative(other.force_density, one.force_density) < 0.02


@pytest.mark.parametrize("errors", [{}, {"sigma": 2e-5}, {"covariance": np.tile(4e-10 * np.eye(3), (60, 1, 1))}])
def test_a_frame_that_shows_nothing_tells_nothing(errors):
    body, rng = plate((5, 4, 3)), np.random.default_rng(0)
    x, force = blow(body, wind, 12, velocity=[2.0, 0.0, 0.0])
    seen = points(body, x + 2e-5 * rng.normal(size=x.shape))
    visible = seen.visible.copy()
    visible[3] = False
    hidden = replace(seen, x=np.where(visible[..., None], seen.x, np.nan), visible=visible)
    channels = point_channels(body, replace(hidden, **errors), False)
    assert channels.acceleration(body.x, FPS) == pytest.approx(point_channels(body, seen, False).acceleration(body.x, FPS), rel=0.2)
    found = recover(body, RUBBER, replace(hidden, **errors), FPS, WEIGHTLESS, NoProgress())
    assert relative(found.force_density, 400.0 * force) < 0.03


def test_fewer_points_than_modes_in_all_frames():
    body = plate((4, 4, 4))
    x, _ = blow(body, wind, 6)
    visible = np.ones(x.shape[:2], bool)
    visible[1:, 19:] = False
    targets = replace(points(body, x), visible=visible, covariance=np.tile(1e-10 * np.eye(3), (64, 1, 1)))
    assert np.isfinite(recover(body, RUBBER, targets, FPS, WEIGHTLESS, NoProgress()).force_density).all()


def test_poor_points_do_not_count_as_good_ones():
    body, rng = plate((4, 4, 4)), np.random.default_rng(0)
    x, _ = blow(body, wind, 8)
    sigma = np.where(np.arange(64) < 4, 1e-6, 3e-3)
    shaken = x + sigma[:, None] * rng.normal(size=x.shape)
    channels = point_channels(body, replace(points(body, shaken), covariance=sigma[:, None, None] ** 2 * np.eye(3)), False)
    off = channels.residual(x[5][None], 5)[0] / channels.sigma
    assert np.sqrt((off**2).mean()) < 1.5


BODY = plate((4, 4, 3))
STILL = np.repeat(BODY.x[None], 6, axis=0)
ONE = np.eye(3) * 1e-8


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"sigma": -0.01}, UsageError, "sigma, is -0.01"),
        ({"sigma": np.nan}, UsageError, "sigma, is nan"),
        ({"sigma": np.eye(3)}, UsageError, "sigma"),
        ({"covariance": ONE}, UsageError, r"\(3, 3\)"),
        ({"covariance": np.tile(-ONE, (48, 1, 1))}, UsageError, "positive definite"),
        ({"covariance": np.tile(1e-10 * np.array([[1, 0.9, 0], [0, 1, 0], [0, 0, 1]]), (48, 1, 1))}, UsageError, "symmetric"),
        ({"covariance": np.full((48, 3, 3), np.nan)}, UsageError, "Covariances"),
        ({"visible": np.ones((6, 48), int)}, UsageError, "int64"),
        ({"visible": np.arange(6)[:, None] % 5 + np.zeros((6, 48)) == 0}, ObjectError, "2 frames"),
    ],
)
def test_targets_that_make_no_sense_are_refused(change, error, words):
    with pytest.raises(error, match=words) as caught:
        recover(BODY, RUBBER, replace(points(BODY, STILL), **change), FPS, WEIGHTLESS, NoProgress())
    assert isinstance(caught.value, SeeingWindError) and caught.value.hint


@pytest.mark.parametrize("spacing", [0.0, np.nan])
def test_a_body_without_a_spacing_is_refused(spacing):
    with pytest.raises(ObjectError, match="spacing"):
        recover(replace(BODY, spacing=spacing), RUBBER, points(BODY, STILL), FPS, WEIGHTLESS, NoProgress())


def test_a_body_that_stays_still_is_not_said_to_miss_its_points():
    still = STILL + 1e-16 * np.random.default_rng(0).normal(size=STILL.shape)
    notes = recover(BODY, RUBBER, points(BODY, still), FPS, WEIGHTLESS, NoProgress()).notes
    assert any("hardly moves" in note for note in notes) and not any("explains" in note for note in notes)


def test_the_force_on_a_held_body_that_does_not_move_is_known_as_well_as_its_points_would_show_it():
    """Not better: nothing in the clip says so. And nothing is looked for that is not there."""
    body = plate((2, 2, 9), pinned=lambda X: X[:, 2] < -0.07)
    found = recover(body, RUBBER, points(body, np.repeat(body.x[None], 41, axis=0)), FPS, WEIGHTLESS, NoProgress())
    assert not found.force_density.any() and "hardly moves" in found.notes[0]
    assert found.iterations <= len(blocks(40))
    for t in (5, 35):
        push = np.sqrt((found.deviation[t, ~body.pinned] ** 2).mean(axis=0)) / RUBBER.density
        way = np.abs(blow(body, lambda X, t, push=push: np.zeros_like(X) + push, 12)[0] - body.x).max()
        assert 1e-4 < way / body.spacing < 0.05

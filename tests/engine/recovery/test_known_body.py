"""What is known of a held body beforehand: frames of still air, and another clip of the same body."""

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.conventions import in_units
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.clip import still_frames
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.solve.known_body import KnownBody
from seeing_wind.engine.recovery.solve.section import section_axes, section_rotation, section_shapes
from seeing_wind.engine.settings import RecoverSettings
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, plate, points, relative

SOFT = replace(RUBBER, youngs_modulus=0.75 * RUBBER.youngs_modulus)
"""The material that is assumed for a body of RUBBER."""
RINGS = 18


def post(side=2):
    return plate((side, side, 9), pinned=lambda X: X[:, 2] < -0.07)


def kick(X, t):
    """A push of four frames; then the air is still."""
    return np.zeros_like(X) + [3.0 * (t < 4), 1.0 * (t < 4), 0.0]


def breath(X, t):
    """A slow push that rises through the clip: half a swing, which says little about the stiffness."""
    return np.zeros_like(X) + [0.4 * t, 0.0, 0.0]


def error(found, body, wind):
    free = ~body.pinned
    return relative(found.force_density[:, free], RUBBER.density * wind[:, free])


@pytest.fixture(scope="module")
def rung():
    """A kicked post: its points, the wind, and the recovery that is told in which frames the air is still."""
    body = post()
    x, wind = blow(body, kick, RINGS)
    seen = [points(body, x)]
    return body, seen, wind, recover(body, SOFT, seen, FPS, replace(WEIGHTLESS, still=(5, RINGS - 1)), NoProgress())


def test_no_force_is_found_in_still_air(rung):
    body, seen, wind, found = rung
    assert not found.force_density[5:].any() and not found.deviation[5:].any()
    assert found.force_density[:4].any() and found.deviation[:4].all()
    blind = recover(body, SOFT, seen, FPS, WEIGHTLESS, NoProgress())
    assert np.abs(blind.force_density[5:]).max() > 0.02 * np.abs(blind.force_density).max()  # the ringing has no force of its own
    assert error(found, body, wind) < error(blind, body, wind)


def test_a_part_of_the_clip_may_be_still_throughout():
    body, frames = post(), 36
    x, _ = blow(body, kick, frames)
    settings = replace(WEIGHTLESS, still=(5, frames - 1), stiffness="given", iterations=2)
    found = recover(body, RUBBER, [points(body, x)], FPS, settings, NoProgress())
    assert found.force_density[:4].any() and not found.force_density[5:].any()
    assert found.residual.max() < 0.1 * np.linalg.norm(x - x[0], axis=2).max()


def test_a_body_that_is_lost_in_still_air_is_followed_again_all_the_same():
    body, frames = post(), 30
    x, _ = blow(body, kick, frames)
    wrong = replace(RUBBER, youngs_modulus=0.3 * RUBBER.youngs_modulus)
    settings = replace(WEIGHTLESS, still=(5, frames - 1), stiffness="given", iterations=2)
    found = recover(body, wrong, [points(body, x)], FPS, settings, NoProgress())
    assert found.force_density[:4].any() and not found.force_density[5:].any()


def test_ringing_in_still_air_tells_the_stiffness(rung):
    _, _, _, found = rung
    assert found.youngs_modulus == pytest.approx(RUBBER.youngs_modulus, rel=0.03)
    assert found.held_covariance.shape == (4, 4) and found.section.shape == (2,) and found.cell > 0.0


def test_a_body_known_from_another_clip_keeps_its_stiffness_in_one_that_tells_little(rung):
    body, known = rung[0], KnownBody.of(rung[3], "other.take")
    x, wind = blow(body, breath, 5)
    seen = [points(body, x)]
    alone = recover(body, SOFT, seen, FPS, WEIGHTLESS, NoProgress())
    told = recover(body, SOFT, seen, FPS, WEIGHTLESS, NoProgress(), known=known)
    assert told.youngs_modulus == pytest.approx(RUBBER.youngs_modulus, rel=0.05)
    assert error(told, body, wind) < 0.9 * error(alone, body, wind)
    fixed = recover(body, SOFT, seen, FPS, replace(WEIGHTLESS, stiffness="given"), NoProgress(), known=known)
    assert fixed.youngs_modulus == pytest.approx(known.youngs_modulus) and fixed.clamp_depth == pytest.approx(known.clamp / fixed.cell)


def test_notes_tell_of_the_body_as_stiff_as_it_was_found(rung):
    """Not as the preset, which the solver would have had to soften, and nobody gave."""
    body, known = rung[0], KnownBody.of(rung[3], "other.take")
    x, _ = blow(body, breath, 5)
    steel = replace(RUBBER, youngs_modulus=1e9)
    settings = replace(WEIGHTLESS, stiffness="given", iterations=1)
    found = recover(body, steel, [points(body, x)], FPS, settings, NoProgress(), known=known)
    assert found.youngs_modulus == pytest.approx(known.youngs_modulus)
    assert not any("too stiff for the solver" in note for note in found.notes)
    assert [note for note in found.notes if "(as given" in note and in_units(known.youngs_modulus, "Pa") in note]


def test_a_known_body_holds_for_other_particles_of_the_same_thing(rung):
    known, other = KnownBody.of(rung[3], "other.take"), post(3)
    model, _ = model_for(other, RUBBER, FPS)
    belief = known.stiffness_of(other, model, free=True)
    assert belief.s == pytest.approx(np.log(known.youngs_modulus / RUBBER.youngs_modulus))
    assert belief.deeper == pytest.approx(known.clamp / model.dx - model.clamp_depth)
    assert belief.known and belief.deviation > np.sqrt(known.covariance[0, 0])
    assert belief.penalty() == 0.0


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, -75.0])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_section_is_the_same_along_other_axes(degrees, mirror):
    body = plate((3, 3, 9), pinned=lambda X: X[:, 2] < -0.07)
    axes = section_axes(body)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    other = np.stack([c * axes[0] + s * axes[1], mirror * (c * axes[1] - s * axes[0])])
    a, b = 0.1, -0.05
    u, v = body.x @ axes.T[:, 0], body.x @ axes.T[:, 1]
    p, q = body.x @ other.T[:, 0], body.x @ other.T[:, 1]
    ours = a * (u**2 - v**2) / 2.0 + b * u * v
    c, d = section_rotation(axes, other) @ [a, b]
    np.testing.assert_allclose(c * (p**2 - q**2) / 2.0 + d * p * q, ours, atol=1e-12)
    assert section_shapes(body).shape == (2, 81)


def test_only_a_held_body_whose_stiffness_was_told_is_known(rung):
    body, seen, _, found = rung
    with pytest.raises(UsageError, match=r"other\.take does not show how stiff its body is"):
        KnownBody.of(replace(found, youngs_modulus=None), "other.take")
    free = plate((2, 2, 5))
    x, _ = blow(free, kick, 4)
    with pytest.raises(UsageError, match="--body is for a held body"):
        recover(free, RUBBER, [points(free, x)], FPS, WEIGHTLESS, NoProgress(), known=KnownBody.of(found, "other.take"))


def test_still_frames_are_some_of_the_clip_s():
    assert still_frames(RecoverSettings(), 5).sum() == 0
    for last in (4, 5):  # the last frame, or the last frame
        np.testing.assert_array_equal(still_frames(RecoverSettings(still=(2, last)), 5), [False, False, True, True, True])
    np.testing.assert_array_equal(still_frames(RecoverSettings(still=(12, 14)), 5, 10), [False, False, True, True, True])
    for wrong, says in (((7, 9), "not used: 0 to 5 are"), ((2, 9), "not used: 0 to 5 are"), ((0, 4), "all frames that are used, 0 to 5")):
        with pytest.raises(UsageError, match=says):
            still_frames(RecoverSettings(still=wrong), 5)

"""A held body's stiffness is recovered with the force where the clip determines it, and only there."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser, settings_of
from seeing_wind.engine.conventions import in_units
from seeing_wind.engine.materials import LIMITS
from seeing_wind.engine.mpm.model_for import model_for, with_clamp_depth
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Body, Gaussians, Recovery, Surface, TrackTargets, as_found, body_as_found
from seeing_wind.engine.recovery.blocks import most_modes
from seeing_wind.engine.recovery.diagnostics.remarks import wider_remarks
from seeing_wind.engine.recovery.prior.constants import PRIOR
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.recovery.resimulate import simulate_bodies
from seeing_wind.engine.recovery.solve import block as blocks
from seeing_wind.engine.recovery.solve import stiffness
from seeing_wind.engine.recovery.solve.constants import PACE
from seeing_wind.engine.recovery.solve.section import section_shapes
from seeing_wind.engine.recovery.solve.stiffness import Stiffness, is_free, remark, scaled, stiffest, youngs_modulus
from seeing_wind.engine.settings import BodyEdit, Edit, RecoverSettings
from tests.engine.mpm.bodies import retardation_of
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, camera, every, plate, points, relative

TOO_STIFF = replace(RUBBER, youngs_modulus=1.3 * RUBBER.youngs_modulus)
LOSSY = replace(RUBBER, loss_factor=0.06)
GIVEN = replace(WEIGHTLESS, stiffness="given")


def post():
    """A post of 18 cm that is held at its foot."""
    return plate((2, 2, 9), pinned=lambda X: X[:, 2] < -0.07)


def gust(X, t):
    """A push that ends; afterwards the post swings freely."""
    return np.zeros_like(X) + [3.0 * (0 <= t < 4), 0.0, 0.0]


def swell(X, t):
    """A push that comes and goes gently, over seven frames."""
    return np.zeros_like(X) + [3.0 * np.sin(np.pi * min(t + 0.5, 7.0) / 7.0) ** 2, 0.0, 0.0]


def filmed(body, x, noise=0.05, seed=0):
    xy = np.stack([camera().project(frame, t)[0] for t, frame in enumerate(x)])
    xy[1:] += noise * np.random.default_rng(seed).standard_normal(xy[1:].shape)
    return TrackTargets(xy, np.ones(xy.shape[:2], bool), np.full(xy.shape[:2], noise), camera(), every(body))


class AsFound:
    """The recovered force on the recovered body, without the error of a field's representation."""

    kind = "force"

    def __init__(self, found, body):
        self.found, self.fps, self.frames = found, FPS, len(found.force_density)
        self.box = np.array([body.x.min(axis=0) - 1.0, body.x.max(axis=0) + 1.0])

    def sample(self, x, frame):
        return self.found.force_density[frame], np.ones(len(x))

    def gradient(self, x, frame):
        return np.zeros((len(x), 3, 3))


def error(found, body, wind):
    free = ~body.pinned
    return relative(found.force_density[:, free, 0], RUBBER.density * wind[:, free, 0])


@pytest.fixture(scope="module")
def swing():
    """The post, its tracks, the wind, and the recovery from a material that is 30 % too stiff."""
    body = post()
    x, wind = blow(body, gust, 14)
    return body, [filmed(body, x)], wind, recover(body, TOO_STIFF, [filmed(body, x)], FPS, WEIGHTLESS, NoProgress())


@pytest.fixture(scope="module")
def given(swing):
    """The recovery with that material's stiffness kept."""
    body, tracks, _, _ = swing
    return recover(body, TOO_STIFF, tracks, FPS, GIVEN, NoProgress())


def test_the_stiffness_of_a_post_that_swings_is_found_with_the_force(swing, given):
    body, _, wind, found = swing
    assert given.youngs_modulus is None and given.stiffness_deviation is None
    off = np.log(found.youngs_modulus / RUBBER.youngs_modulus)
    assert abs(off) < 3.0 * found.stiffness_deviation and found.stiffness_deviation < PRIOR.stiffness_told * PRIOR.stiffness_spread
    assert error(found, body, wind) < 0.7 * error(given, body, wind)
    assert any(in_units(found.youngs_modulus, "Pa") in note and "below the given 6.5 kPa" in note for note in found.notes)
    assert not any("Young's modulus" in note for note in given.notes)
    # What stands for the stiffness in everything after the recovery.
    assert as_found(TOO_STIFF, found).youngs_modulus == found.youngs_modulus and as_found(TOO_STIFF, given) == TOO_STIFF


def test_what_was_found_is_kept_in_the_take(swing):
    for found in (swing[3], replace(swing[3], stiffness=None)):
        again = from_arrays(Recovery, to_arrays(found))
        assert again.youngs_modulus == found.youngs_modulus and (again.stiffness is None) == (found.stiffness is None)
        if found.stiffness is not None:
            np.testing.assert_array_equal(again.stiffness, found.stiffness)
    assert swing[3].stiffness is not None


def test_points_in_3d_tell_the_stiffness_too(swing):
    body, _, wind, _ = swing
    x, _ = blow(body, gust, 14)
    found = recover(body, TOO_STIFF, [points(body, x)], FPS, WEIGHTLESS, NoProgress())
    given = recover(body, TOO_STIFF, [points(body, x)], FPS, GIVEN, NoProgress())
    assert given.youngs_modulus is None
    off = abs(np.log(found.youngs_modulus / RUBBER.youngs_modulus))
    assert off < 3.0 * found.stiffness_deviation < 3.0 * PRIOR.stiffness_told * PRIOR.stiffness_spread
    assert error(found, body, wind) < 0.7 * error(given, body, wind)


def test_the_field_moves_the_recovered_body_as_it_was_seen_to_move(swing):
    body, _, _, found = swing
    moved = np.abs(found.x - found.x[0]).max()
    off, as_given = (missed(body, TOO_STIFF, found, one) for one in (found, replace(found, youngs_modulus=None)))
    assert off < 0.05 * moved < as_given


def test_a_damped_body_comes_to_rest_as_it_was_seen_to():
    body = post()
    x, _ = blow(body, swell, 16, material=LOSSY)
    found = recover(body, LOSSY, [points(body, x)], FPS, WEIGHTLESS, NoProgress())
    assert 1.5 * missed(body, LOSSY, found, found) < missed(body, RUBBER, found, found)  # 1.9 to 2 times, by the threads of the BLAS


def missed(body, material, found, recovery):
    """Largest distance from the recovered motion of a body of this material, with the changes of `recovery`, under the recovered force."""
    cloud = every(body)
    count = len(body.x)
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    gaussians = Gaussians(body.x, np.full((count, 3), 0.01), turn, np.ones(count), np.zeros((count, 1, 3)), cloud)
    triangles = np.array([[0, 1, 2]], dtype=np.int32)
    whole = Body(body, material, gaussians, Surface(body.x, triangles, np.zeros((count, 2)), cloud), cloud, found.x)
    field = AsFound(found, body)
    edit = Edit((BodyEdit("post", "recovered"),), gravity=(0.0, 0.0, 0.0))
    return np.abs(simulate_bodies(edit, field, (whole, recovery), ".")["post"].vertices - found.x).max()


def test_pins_that_reach_too_far_up_are_moved_down(swing):
    body, tracks, wind, _ = swing
    long = replace(body, pinned=body.x[:, 2] < -0.05)  # a layer of particles more, 0.6 cells
    found = recover(long, RUBBER, tracks, FPS, WEIGHTLESS, NoProgress())
    given = recover(long, RUBBER, tracks, FPS, GIVEN, NoProgress())
    assert given.clamp_depth == GIVEN.clamp_depth and 0.2 < found.clamp_depth - GIVEN.clamp_depth < 1.0
    assert error(found, long, wind) < 0.6 * error(given, long, wind)


def test_a_model_held_elsewhere_is_the_one_built_so():
    body = post()
    built, _ = model_for(body, RUBBER, FPS, clamp_depth=0.7)
    moved = with_clamp_depth(model_for(body, RUBBER, FPS, clamp_depth=0.1)[0], body, 0.7)
    for name in ("offset", "clamp_lo", "clamp", "role", "mass", "clamp_depth"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(built, name))


def test_a_stiffness_that_the_clip_does_not_tell_stays():
    body = post()
    x, _ = blow(body, lambda X, t: np.zeros_like(X) + [0.02 * t, 0.0, 0.0], 6)
    found = recover(body, TOO_STIFF, [filmed(body, x, 0.5)], FPS, WEIGHTLESS, NoProgress())
    assert found.youngs_modulus is None and as_found(TOO_STIFF, found) == TOO_STIFF
    assert any("does not show how stiff" in note for note in found.notes)


def test_a_step_that_makes_it_worse_is_not_taken(swing, given, monkeypatch):
    body, tracks, _, _ = swing
    monkeypatch.setattr(stiffness.Joint, "step", lambda self: np.array([0.4, 0.0, 0.0, 0.0]))  # stiffer still
    misled = recover(body, TOO_STIFF, tracks, FPS, WEIGHTLESS, NoProgress())
    assert misled.youngs_modulus is None and not any("Young's modulus" in note for note in misled.notes)
    np.testing.assert_allclose(misled.force_density, given.force_density)


def test_a_push_along_one_side_bends_an_uneven_section_along_the_other():
    # The moment of a bend along x is E times the section's sum of x y exp(b u v): to first order b of that of x².
    even = plate((3, 3, 9), pinned=lambda X: X[:, 2] < -0.07)
    shapes = section_shapes(even)
    assert shapes.shape == (2, 81) and np.abs(shapes).max() <= 2.0
    x, _ = blow(even, gust, 6)
    tip = even.x[:, 2] > 0.07
    u, v = (even.x[:, i] / even.x[:, i].std() for i in (0, 1))
    off = []
    for b in (-0.2, 0.2):
        uneven, _ = blow(replace(even, stiffness=np.exp(b * u * v)), gust, 6)
        off.append((uneven - even.x)[-1, tip, 1].mean() / (x - even.x)[-1, tip, 0].mean())
    assert off[0] == pytest.approx(-off[1], rel=0.05) and 0.01 < -off[1] < 0.2  # softer along the diagonal it is stiffer across


def test_an_uneven_section_is_found_with_the_force():
    even = plate((3, 3, 9), pinned=lambda X: X[:, 2] < -0.07)
    sizes = np.array([0.0, 0.2])
    body = replace(even, stiffness=np.exp(sizes @ section_shapes(even)))
    x, wind = blow(body, gust, 14)
    found = recover(even, RUBBER, [points(even, x)], FPS, WEIGHTLESS, NoProgress())
    got = np.linalg.lstsq(section_shapes(even).T, np.log(found.stiffness), rcond=None)[0]
    assert 0.1 < got[1] < 0.25 and abs(got[0]) < 0.1  # a force across, which could do the same, is believed to be small
    across = np.abs(found.force_density[:, ~even.pinned, 1]).mean()
    assert across < 0.15 * np.abs(RUBBER.density * wind[:, ~even.pinned, 0]).mean()
    given = recover(even, RUBBER, [points(even, x)], FPS, GIVEN, NoProgress())
    assert given.stiffness is None and across < 0.7 * np.abs(given.force_density[:, ~even.pinned, 1]).mean()


def test_a_section_is_told_better_by_particles_that_were_seen_than_by_guessed_ones():
    seen, guessed = (np.sqrt(np.diag(Stiffness.unknown(True, seen=each).covariance)) for each in (True, False))
    np.testing.assert_array_equal(seen[:2], guessed[:2])
    assert (seen[2:] <= 0.5 * guessed[2:]).all()


def test_only_what_is_held_has_a_section():
    with pytest.raises(ValueError, match="held in part"):
        section_shapes(plate((3, 3, 3)))


def test_it_is_free_only_for_held_bodies():
    body, free = post(), plate((2, 2, 7))
    assert is_free(body, RecoverSettings())
    assert not is_free(body, RecoverSettings(stiffness="given"))
    assert not is_free(free, RecoverSettings())


def test_the_setting_on_the_command_line():
    for words, expected in (([], "free"), (["--stiffness", "given"], "given")):
        for verb in (["recover", "clip.mp4"], ["recover-trajectories", "points.npz"]):
            arguments = parser().parse_args([*verb, "--take", "t", *words])
            assert settings_of(RecoverSettings, arguments).stiffness == expected


def test_a_stiffer_body_keeps_its_ratio_and_gets_the_substeps_it_needs():
    model, _ = model_for(post(), RUBBER, FPS)
    other = scaled(model, 0.5)
    assert youngs_modulus(model, post()) == pytest.approx(RUBBER.youngs_modulus)
    assert youngs_modulus(other, post()) == pytest.approx(np.exp(0.5) * RUBBER.youngs_modulus) == youngs_modulus(model, post(), 0.5)
    np.testing.assert_allclose(other.lam / other.mu, model.lam / model.mu)
    lossy = replace(RUBBER, loss_factor=0.02)
    damped, _ = model_for(post(), lossy, FPS)
    assert retardation_of(scaled(damped, 0.5)) == pytest.approx(retardation_of(damped)) == pytest.approx(lossy.retardation)
    again, _ = model_for(post(), replace(RUBBER, youngs_modulus=youngs_modulus(other, post())), FPS)
    assert other.substeps >= again.substeps and scaled(model, -0.5).substeps == model.substeps
    assert scaled(model, stiffest(model)).substeps <= LIMITS.max_substeps_held + 1


def test_the_substeps_carry_the_stiffest_side_of_an_uneven_section():
    body = plate((3, 3, 9), pinned=lambda X: X[:, 2] < -0.07)
    model, _ = model_for(body, RUBBER, FPS)
    uneven = Stiffness(True, q=np.array([0.1, 0.0, 0.4, 0.0])).of(model, body)
    alike, _ = model_for(body, replace(RUBBER, youngs_modulus=RUBBER.youngs_modulus * float((uneven.mu / model.mu).max())), FPS)
    assert uneven.mu.max() > 1.2 * np.exp(0.1) * model.mu.max() and uneven.substeps >= alike.substeps


def test_one_stiffness_for_all_blocks_of_a_clip(monkeypatch):
    stage = sys.modules["seeing_wind.engine.recovery.blocks"]
    monkeypatch.setattr(stage, "PACE", replace(PACE, block=10, overlap=4))
    body, fractions, solved = post(), [], []
    x, _ = blow(body, lambda X, t: gust(X, t - 9), 16)
    run = blocks.BlockSolver.run
    monkeypatch.setattr(blocks.BlockSolver, "run", lambda self: solved.append((self.start is None, self.stiffness)) or run(self))
    heard = Progress(lambda message: fractions.append(message["fraction"]))
    found = recover(body, TOO_STIFF, [filmed(body, x)], FPS, WEIGHTLESS, heard)
    assert fractions == sorted(fractions) and fractions[-1] <= 1.0
    # The post stands still in the first block, so the second one tells; then both are solved for that body.
    assert [start for start, _ in solved] == [True, False, True, False]
    assert [stiffness.free for _, stiffness in solved] == [True, True, False, False]
    assert len({stiffness.s for _, stiffness in solved[2:]}) == 1
    assert abs(np.log(found.youngs_modulus / RUBBER.youngs_modulus)) < 3.0 * found.stiffness_deviation


def test_a_body_that_is_lost_tells_no_stiffness(swing, monkeypatch):
    body, tracks, _, _ = swing
    monkeypatch.setattr(blocks, "PACE", replace(PACE, stiffness_lost=-1.0))
    found = recover(body, TOO_STIFF, tracks, FPS, WEIGHTLESS, NoProgress())
    assert found.youngs_modulus is None and not [note for note in found.notes if "The motion fits" in note]


@pytest.mark.parametrize(
    ("cells", "says"), [(0.001, "begins at the border"), (0.2, "mm inside the border"), (-0.2, "mm outside the border")]
)
def test_where_the_clamp_was_found_is_told_in_words(cells, says):
    model, _ = model_for(post(), RUBBER, FPS)
    (note,) = remark(Stiffness(True, np.array([0.0, cells, 0.0, 0.0]), 1e-6 * np.eye(4)), model, post())
    assert says in note and " 0.0" not in note


def test_thin_parts_that_are_simulated_thicker_are_told_and_keep_their_material(swing):
    body = replace(post(), stiffness=np.full(len(post().x), 0.25))
    model, _ = model_for(body, RUBBER, FPS)
    assert youngs_modulus(model, body) == pytest.approx(RUBBER.youngs_modulus)
    assert model.mu.max() == pytest.approx(0.25 * model_for(post(), RUBBER, FPS)[0].mu.max())
    assert model.substeps <= model_for(post(), RUBBER, FPS)[0].substeps
    note = wider_remarks(body)
    assert "2.0 times as thick" in note[0] and "1/4" in note[0] and wider_remarks(post()) == []
    spread = np.linspace(0.9, 1.1, len(body.x))
    found = replace(swing[3], stiffness=spread)
    np.testing.assert_allclose(body_as_found(body, found).stiffness, 0.25 * spread)
    np.testing.assert_allclose(body_as_found(post(), found).stiffness, spread)
    assert body_as_found(body, replace(found, stiffness=None)).stiffness is body.stiffness


def test_few_particles_that_stand_for_a_thinner_thing_have_few_modes():
    body = post()
    assert most_modes(body) == 16 and most_modes(replace(body, stiffness=np.full(len(body.x), 0.25))) == 4

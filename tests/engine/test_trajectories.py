"""3D trajectories from files: what is read, and what is refused in one sentence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.trajectories.bodies import read_trajectories
from seeing_wind.engine.command.trajectories.file import READ, TRUTH
from seeing_wind.engine.command.trajectories.sheets import read_sheet
from seeing_wind.engine.command.trajectories.spacing import particle_spacing
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.conventions import DISTRUST
from seeing_wind.engine.errors import MaterialError, ObjectError, SeeingWindError, UsageError
from seeing_wind.engine.field import distillation
from seeing_wind.engine.materials import LIMITS, find
from seeing_wind.engine.progress import NoProgress, Progress

LATTICE = 0.1 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
FALL = np.stack([LATTICE - [0, 0, 4.9 * (t / 24) ** 2] for t in range(6)])


def write(path: Path, **values: Any) -> Path:
    np.savez(path, **{"x": FALL, "fps": 24.0, "E": 1e5, **values})
    return path


def test_what_the_file_says(tmp_path: Path) -> None:
    source = read_trajectories(write(tmp_path / "t.npz", rho=500.0, E=1e4, nu=0.2, gravity=[0, 0, -1.6], v=np.zeros(1)))
    assert source.fps == 24.0 and source.gravity == (0.0, 0.0, -1.6) and source.particles.spacing == pytest.approx(0.1)
    assert (source.material.density, source.material.youngs_modulus, source.material.poisson_ratio) == (500.0, 1e4, 0.2)
    assert read_trajectories(write(tmp_path / "t.npz")).gravity == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"fps": 0.0},
        {"fps": 1e300},
        {"fps": 1e-300},
        {"sigma": 1e300},
        {"E": 1e300},
        {"rho": 1e-300},
        {"x": FALL + 1e8},
        {"x": FALL + 50.0 * (np.arange(6) > 2)[:, None, None]},
        {"material": "unobtainium"},
        {"material": ["leaf", "leaf"]},
        {"covariance": -np.eye(3)},
        {"covariance": 1e300 * np.eye(3)},
        {"x": np.array(["a"] * 27)},
        {"fps": float("nan")},
        {"fps": [24.0, 25.0]},
        {"fps": "fast"},
        {"gravity": [1.0, 2.0]},
        {"gravity": [0.0, 0.0, float("nan")]},
        {"gravity": 9.81},
        {"gravity": [0.0, 0.0, 1e30]},
        {"rho": np.ones(27)},
        {"rho": 0.0},
        {"yield_stress": -1.0},
        {"x": "abc"},
        {"x": FALL[:2]},
        {"x": np.where(np.arange(6)[:, None, None] == 2, np.nan, FALL)},
        {"x": np.zeros((6, 27, 3))},
        {"fixed": np.ones(3, bool)},
        {"fixed": ["False"] * 27},
        {"fixed": np.full(27, np.nan)},
        {"visible": np.ones(27, bool)},
        {"visible": np.ones((6, 27))},
        {"visible": np.zeros((6, 27), bool)},
        {"visible": np.arange(6)[:, None] * np.ones(27, int) == 0},
        {"sigma": 0.0},
        {"sigma": -1e-3},
        {"sigma": np.inf},
        {"sigma": np.full(27, 1e-3)},
        {"covariance": np.eye(2)},
        {"covariance": np.tile(np.eye(3), (5, 1, 1))},
        {"covariance": np.eye(3) * 1e-6, "sigma": 1e-3},
    ],
)
def test_wrong_values_are_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises(SeeingWindError) as caught:
        read_trajectories(write(tmp_path / "t.npz", **wrong))
    assert caught.value.message and caught.value.hint


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"E": 1e20}, "t.npz: E, Young's modulus, is 1e+20 Pa."),
        ({"E": 1e-5, "material": "rubber"}, "t.npz: E, Young's modulus, is 1e-05 Pa."),
        ({"rho": 1e9, "material": "rubber"}, "t.npz: rho, the density, is 1e+09 kg/m³."),
        ({"nu": 0.5}, "t.npz: nu, Poisson's ratio, is 0.5."),
        ({"yield_stress": 1e14}, "t.npz: yield_stress is 1e+14 Pa."),
        ({"yield_stress": -1.0}, "t.npz: yield_stress is -1 Pa."),
        ({"covariance": -np.eye(3) * 1e-6}, "-0.0, -1e-06]] m², which has the negative eigenvalue -1e-06."),
        ({"covariance": 1e-6 * np.eye(3) + np.where(np.arange(27) == 26, np.nan, 0.0)[:, None, None]}, "covariance of point 26 is [[nan"),
        ({"covariance": 1e-6 * np.triu(np.ones((3, 3)))}, "which is not symmetric"),
        ({"covariance": 1e3 * np.eye(3)}, "which is more than what x reaches"),
    ],
)
def test_what_is_refused_is_shown(tmp_path: Path, wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(SeeingWindError) as caught:
        read_trajectories(write(tmp_path / "t.npz", **wrong))
    assert says in caught.value.message and caught.value.hint


def test_an_option_in_place_of_what_the_file_says_wrongly_is_taken(tmp_path: Path) -> None:
    assert read_trajectories(write(tmp_path / "t.npz", E=1e20), youngs_modulus=2e5).material.youngs_modulus == 2e5
    with pytest.raises(MaterialError, match="^Young's modulus"):
        read_trajectories(write(tmp_path / "t.npz"), youngs_modulus=1e20)


def test_a_stiffness_is_stated_or_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", x=FALL, fps=24.0)
    with pytest.raises(MaterialError, match="lacks E, Young's modulus") as caught:
        read_trajectories(tmp_path / "t.npz")
    assert "--youngs-modulus" in caught.value.hint
    assert read_trajectories(tmp_path / "t.npz", youngs_modulus=2e4).material.youngs_modulus == 2e4
    np.savez(tmp_path / "t.npz", x=FALL, fps=24.0, material="Rubber", rho=700.0)
    named = read_trajectories(tmp_path / "t.npz").material
    assert (named.youngs_modulus, named.density) == (find("rubber").youngs_modulus, 700.0)
    same = read_trajectories(write(tmp_path / "t.npz", material="elastic", rho=1.0, nu=0.1)).material
    assert (same.name, same.youngs_modulus) == ("trajectories", 1e5)


def test_a_body_of_few_points_is_told_first(tmp_path: Path) -> None:
    assert "3 points" in read_trajectories(write(tmp_path / "t.npz", x=FALL[:, :3])).notes[0]


@pytest.mark.parametrize(("unit", "asked"), [(1000.0, "200 m across: are its points in millimetres"), (1e-3, "0.2 mm across"), (1.0, "")])
def test_a_body_of_a_size_that_nobody_films_is_asked_about(tmp_path: Path, unit: float, asked: str) -> None:
    x = unit * (0.9 * LATTICE + 0.1 * FALL)
    shell = {"faces": np.array([[0, 1, 3]]), "areal_density": 0.1, "thickness": 4e-4}
    path = write(tmp_path / "t.npz", x=x)
    for notes in (read_trajectories(path).notes, read_sheet(write(tmp_path / "s.npz", x=x, **shell))[2]):
        assert (asked in notes[0]) if asked else not any("across" in note for note in notes)
    alone = read_trajectories(write(tmp_path / "t.npz", x=x[:, :1])).notes
    assert not any("across" in note for note in alone)


def test_what_is_assumed_or_contradicts_itself_is_told(tmp_path: Path) -> None:
    assert read_trajectories(write(tmp_path / "t.npz", rho=500.0, E=1e4, nu=0.2, gravity=np.zeros(3))).notes == ()
    lacking, weightless = read_trajectories(write(tmp_path / "t.npz", E=1e4)).notes
    assert "rho (300 kg/m³), nu (0.3)" in lacking and "proportional to the density" in lacking and "no gravity" in weightless
    fixed = np.arange(27) < 5
    assert any("held move by up to 210 mm" in note for note in read_trajectories(write(tmp_path / "t.npz", fixed=fixed)).notes)
    seen = np.arange(6)[:, None] < np.where(fixed, 3, 6)  # what held particles did unseen is not known
    source = read_trajectories(write(tmp_path / "t.npz", x=np.where(seen[..., None], FALL, np.nan), visible=seen, fixed=fixed))
    assert any("held move by up to 34 mm" in note for note in source.notes)


def test_a_particle_that_leaves_its_body_makes_the_field_useless(tmp_path: Path) -> None:
    """Else each particle gets a force of its own that explains its flight to the last digit."""
    astray = FALL.copy()
    astray[:, 13] += np.linspace(0.0, 32.0, 6)[:, None] * [1.0, 0.0, 0.0]
    notes = read_trajectories(write(tmp_path / "t.npz", x=astray)).notes
    assert any("1 of 27 particles (13) go up to 31.9 m" in note and DISTRUST in note for note in notes)
    hidden = np.ones((6, 27), bool)
    hidden[1:, 13] = False
    halves = FALL + np.where(LATTICE[:, :1] > 0.15, 1.0, 0.0) * np.linspace(0.0, 3.0, 6)[:, None, None]
    for values in ({"x": astray, "visible": hidden}, {"x": halves}, {}):
        assert not any("go up to" in note for note in read_trajectories(write(tmp_path / "t.npz", **values)).notes)


def test_held_particles_that_move_together_or_within_their_errors_are_not_said_to_stand_still(tmp_path: Path) -> None:
    fixed, time = LATTICE[:, 2] < 0.05, np.arange(30)[:, None, None]
    carried = LATTICE + 0.2 * np.sin(0.3 * time) * [1.0, 0.0, 0.0]
    noisy = LATTICE + np.where(time > 0, 0.015 * np.random.default_rng(1).standard_normal((30, 27, 3)), 0.0)
    bent = carried + 5.0 * np.sin(0.3 * time) * (LATTICE[:, :1] * (0.2 - LATTICE[:, :1])) * [0.0, 1.0, 0.0]
    for values, said in (({"x": carried}, ""), ({"x": noisy, "sigma": 0.015}, ""), ({"x": bent}, "against each other")):
        notes = [note for note in read_trajectories(write(tmp_path / "t.npz", fixed=fixed, **values)).notes if "held" in note]
        assert len(notes) == bool(said) and all(said in note for note in notes), notes


def test_a_body_holds_together_where_its_particles_lie_closer_one_way_than_the_others() -> None:
    def grid(x: int, y: int, z: int) -> np.ndarray:
        return np.stack(np.meshgrid(*(np.arange(float(n)) for n in (x, y, z)), indexing="ij"), axis=-1).reshape(-1, 3)

    wide = 0.012
    assert particle_spacing(wide * grid(6, 6, 6)) == pytest.approx(wide)
    for layers in (2, 12):
        plate = grid(9, layers, 9) * [wide, 0.006 / (layers - 1), wide]
        cell = LIMITS.cell_spacings * particle_spacing(plate)
        assert wide < cell < 2.0 * wide
        astray = np.concatenate([plate, plate[:1] + 1.0])  # one of many that lies apart changes nothing
        assert particle_spacing(astray) == pytest.approx(particle_spacing(plate))


def test_a_held_layer_of_points_does_not_show_its_thickness(tmp_path: Path) -> None:
    y, z = (each.ravel() for each in np.meshgrid(np.arange(12.0), np.arange(10.0), indexing="ij"))
    flat = 0.1 * np.stack([np.zeros(120), y, z], axis=1)
    shell = 0.1 * np.stack([4.0 * np.cos(y / 4.0), 4.0 * np.sin(y / 4.0), z], axis=1)
    double, near = (np.concatenate([flat, flat + [apart, 0.0, 0.0]]) for apart in (0.1, 0.05))

    def said(x: np.ndarray, held: bool = True) -> bool:
        path = write(tmp_path / "t.npz", x=np.repeat(x[None], 6, axis=0), fixed=held & (x[:, 2] < 0.05))
        return any("in one layer" in note and "simulated 100 mm thick" in note for note in read_trajectories(path).notes)

    assert said(flat) and said(shell) and said(flat[:10])
    assert not said(double) and not said(near) and not said(LATTICE) and not said(flat, held=False)


def test_particles_that_are_held_and_travel_make_the_field_useless(tmp_path: Path) -> None:
    fixed = LATTICE[:, 2] < 0.05
    for way, useless in ((0.05, False), (0.5, True)):
        moved = FALL[:1] + way * np.linspace(0.0, 1.0, 6)[:, None, None] * [1.0, 0.0, 0.0]
        (note,) = (note for note in read_trajectories(write(tmp_path / "t.npz", x=moved, fixed=fixed)).notes if "held" in note)
        assert (DISTRUST in note) == useless


def test_points_that_are_not_visible_are_left_out(tmp_path: Path) -> None:
    visible = np.ones((6, 27), dtype=bool)
    visible[2:4, 7], visible[5, 3] = False, False
    x = np.where(visible[..., None], FALL, np.nan)
    x[5, 3] = 99.0  # some write the last guess, some NaN
    targets = read_trajectories(write(tmp_path / "t.npz", x=x, visible=visible.astype(np.uint8), sigma=np.array([2e-3]))).targets
    assert targets.visible.dtype == bool and (targets.visible == visible).all() and targets.sigma == 2e-3
    assert (targets.x[visible] == FALL[visible]).all() and np.isnan(targets.x[~visible]).all()
    plain = read_trajectories(write(tmp_path / "t.npz")).targets
    assert plain.visible.all() and plain.sigma is None


def test_the_errors_of_points_may_have_a_direction(tmp_path: Path) -> None:
    one, each = np.diag([1e-8, 4e-6, 1e-8]), np.random.default_rng(0).uniform(1e-8, 1e-6, 27)[:, None, None] * np.eye(3)
    for given in (one, each):
        targets = read_trajectories(write(tmp_path / "t.npz", covariance=given)).targets
        assert targets.sigma is None and (targets.covariance == given).all() and targets.covariance.shape == (27, 3, 3)


def test_what_visible_must_not_say(tmp_path: Path) -> None:
    visible = np.ones((6, 27), dtype=bool)
    visible[0, [4, 9]] = False
    with pytest.raises(ObjectError, match="2 of 27 points are not visible in frame 0, the first of them point 4") as caught:
        read_trajectories(write(tmp_path / "t.npz", visible=visible))
    assert "frame 0" in caught.value.hint
    lost = FALL.copy()
    lost[3, 8, 1] = np.nan
    with pytest.raises(ObjectError, match="particle 8 in frame 3 is not finite"):
        read_trajectories(write(tmp_path / "t.npz", x=lost, visible=np.ones((6, 27), bool)))


def test_keys_that_are_not_read_are_named(tmp_path: Path) -> None:
    known = {"rho": 500.0, "E": 1e4, "nu": 0.2, "gravity": np.zeros(3)}
    quiet = {"v": np.zeros(1), "acc": np.zeros(1), "name": "sheet", "field": "breeze", "wind": np.zeros(1), "force": np.zeros(1)}
    assert set(quiet) == set(TRUTH) and read_trajectories(write(tmp_path / "t.npz", **known, **quiet)).notes == ()
    # Not opened either: it may hold what needs pickle.
    (note,) = read_trajectories(write(tmp_path / "t.npz", **known, foo=np.array([{}], dtype=object))).notes
    assert "foo is not read" in note and "id you mean" not in note and all(key in note for key in READ)
    more = {"density": 1.0, "pinned": np.zeros(27, bool), "Yield_Stress": 1.0, "visibel": 1.0, "foo": 1.0}
    (note,) = read_trajectories(write(tmp_path / "t.npz", **known, **more)).notes
    assert "density, pinned, Yield_Stress, visibel, foo are not read" in note
    assert "Did you mean rho by density, fixed by pinned, yield_stress by Yield_Stress, visible by visibel?" in note


def test_the_source_tells_file_options_and_assumptions_apart(tmp_path: Path) -> None:
    path = write(tmp_path / "t.npz", E=1e4, gravity=np.zeros(3))
    plain = read_trajectories(path)
    assert plain.material.source == "from the trajectory file: youngs_modulus; assumed: density, poisson_ratio"
    given = read_trajectories(path, density=500.0, youngs_modulus=2e4, poisson_ratio=None)
    assert (given.material.density, given.material.youngs_modulus, given.material.poisson_ratio) == (500.0, 2e4, 0.3)
    assert given.material.source == "assumed: poisson_ratio; given by the user: density, youngs_modulus"
    assert len(given.notes) == 1 and "nu (0.3)" in given.notes[0] and "rho" not in given.notes[0] and "E (" not in given.notes[0]
    options = read_trajectories(path, density=500.0, youngs_modulus=2e4, poisson_ratio=0.1)
    assert options.material.source == "given by the user: density, youngs_modulus, poisson_ratio" and options.notes == ()
    preset = read_trajectories(path, find("rubber"), density=500.0)
    assert preset.material.source == f"{find('rubber').source}; given by the user: density"
    assert preset.notes == ("The material rubber replaces what the file says: E.",)
    whole = read_trajectories(write(tmp_path / "t.npz", rho=1.0, E=1.0, nu=0.1, yield_stress=2.0), gravity=(0.0, 0.0, -1.0))
    assert whole.material.source == "from the trajectory file: density, youngs_modulus, poisson_ratio, yield_stress"
    assert whole.notes == () and whole.gravity == (0.0, 0.0, -1.0)


def test_still_frames_that_the_file_does_not_have_are_told_before_a_folder_is_made(tmp_path: Path) -> None:
    words = ["recover-trajectories", str(write(tmp_path / "t.npz")), "--take", str(tmp_path / "t.take"), "--still", "90:99"]
    with pytest.raises(UsageError, match="--still 90:99 names frames that are not used"):
        VERBS["recover-trajectories"](parser().parse_args(words), NoProgress())
    assert not (tmp_path / "t.take").exists()


def test_assumptions_and_visible_reach_the_result_and_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distillation, "ITERATIONS", 40)
    visible = np.ones((6, 27), dtype=bool)
    visible[3:5, 20] = False
    path = write(tmp_path / "t.npz", x=np.where(visible[..., None], FALL, np.nan), visible=visible, sigma=1e-4, pinned=np.zeros(27))
    told: list[dict[str, Any]] = []
    arguments = parser().parse_args(["recover-trajectories", str(path), "--take", str(tmp_path / "t.take"), "--density", "100"])
    for _ in range(2):  # the second time, the take has it all
        result = VERBS["recover-trajectories"](arguments, Progress(told.append))
        report = json.loads((tmp_path / "t.take" / "report.json").read_text())
        assert result["notes"] == report["notes"]
        for words in ("pinned is not read", "lacks nu (0.3)", "no gravity"):
            assert sum(words in note for note in result["notes"]) == 1
            assert any(words in message["message"] for message in told if message["type"] == "warning")
        source = "from the trajectory file: youngs_modulus; assumed: poisson_ratio; given by the user: density"
        assert report["material"]["source"] == source
    force = np.array(report["mean_net_force"]) / report["mass"]
    np.testing.assert_allclose(force, [0.0, 0.0, -9.8], atol=0.3)


@pytest.mark.parametrize("key", ["fps", "rho", "yield_stress", "sigma"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_named(tmp_path: Path, key: str, value: float) -> None:
    with pytest.raises(UsageError, match=f"{key} is {value}, which is not finite") as caught:
        read_trajectories(write(tmp_path / "t.npz", **{key: value}))
    assert "shape" not in caught.value.message


def test_an_array_of_objects_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="x: it holds object, not plain numbers") as caught:
        read_trajectories(write(tmp_path / "t.npz", x=FALL.astype(object)))
    assert "dtype=float" in caught.value.hint


@pytest.mark.parametrize("content", [b"", b"garbage", b"PK\x03\x04garbage"])
def test_files_that_are_no_archive_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "t.npz").write_bytes(content)
    with pytest.raises(UsageError, match="cannot be read as trajectories"):
        read_trajectories(tmp_path / "t.npz")
    np.save(tmp_path / "t.npy", FALL)
    with pytest.raises(UsageError, match="cannot be read as trajectories"):
        read_trajectories(tmp_path / "t.npy")


def test_one_frame_of_many_particles_is_counted_as_such(tmp_path: Path) -> None:
    with pytest.raises(ObjectError, match="has 1 frame of 27 particles"):
        read_trajectories(write(tmp_path / "t.npz", x=FALL[:1]))

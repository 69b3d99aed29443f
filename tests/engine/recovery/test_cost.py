"""The estimate of how long a solve will take, from its size and this machine's speed; none where the speed is not known."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.courant import substeps_of
from seeing_wind.engine.progress import Cancelled, Progress
from seeing_wind.engine.recovery import cost, stage
from seeing_wind.engine.recovery.cost import Speed, Work, known_speed, measure_speed, work_of
from seeing_wind.engine.settings import RecoverSettings
from seeing_wind.engine.take import Take
from tests.engine.recovery.bodies import FPS, RUBBER, plate, points

MEASURED = cost._measured
"""The function itself, which tests/engine/conftest.py replaces."""
SPEED = Speed(copy=2e-7, base=2e-6, change=2e-8)
CLAY = dataclasses.replace(RUBBER, law="von_mises", yield_stress=2e3)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for the measured speed."""
    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", str(tmp_path / "kernels"))
    return tmp_path / "kernels" / cost.FILE


def seconds(body=None, material: Material = RUBBER, frames: int = 24, points: int = 40, **settings) -> float:
    """Estimated seconds of a solve on a machine of known speed."""
    work = work_of(plate() if body is None else body, material, FPS, frames, points, RecoverSettings(**settings))
    assert work is not None
    return work.seconds(SPEED)


def held(body):
    """The body with its particles on one side held."""
    return dataclasses.replace(body, pinned=body.x[:, 0] < -0.05)


def test_a_solve_takes_longer_with_more_of_everything() -> None:
    twice = dataclasses.replace(plate(), x=np.concatenate([plate().x, plate().x + 1e-4]), volume=np.tile(plate().volume, 2) / 2,
                                pinned=np.tile(plate().pinned, 2))  # fmt: skip
    assert seconds(twice) == pytest.approx(2.0 * seconds(), rel=0.05)
    stiffer = dataclasses.replace(RUBBER, youngs_modulus=4.0 * RUBBER.youngs_modulus)
    ratio = substeps_of(plate(), stiffer, FPS) / substeps_of(plate(), RUBBER, FPS)
    assert 1.5 < ratio <= 2.1 and seconds(material=stiffer) == pytest.approx(ratio * seconds())
    # Within a block the unknowns grow with the frames, but not the columns that are carried for them.
    assert 1.7 < seconds(frames=32) / seconds(frames=16) < 2.6
    assert 1.5 < seconds(frames=168) / seconds(frames=88) < 2.2


def test_what_is_looked_for_counts() -> None:
    assert seconds(held(plate())) > 1.3 * seconds(), "its stiffness is found, too"
    assert seconds(points=1) < 0.9 * seconds(), "a body that is seen as one point has a uniform force"
    assert seconds(iterations=1) < 0.7 * seconds(), "a draft"
    for body in (plate(), held(plate())):
        assert seconds(body, frames=88) < 2.6 * seconds(body, frames=32), "later blocks know how the force varies"
    assert seconds(material=CLAY, frames=88) > 2.4 * seconds(material=CLAY, frames=32), "where the body does not flow"


def test_a_body_that_strays_takes_longer_for_each_block_in_which_it_does() -> None:
    def work(*strayed: int) -> float:
        found = work_of(plate(), RUBBER, FPS, 88, 40, RecoverSettings(), *strayed)
        assert found is not None
        return found.seconds(SPEED)

    assert work(0, 0) == seconds(frames=88)
    one, all_four, finely = work(1, 0), work(4, 0), work(1, 1)
    assert one - work(0, 0) == pytest.approx(0.25 * (all_four - work(0, 0))) and one > 1.1 * work(0, 0)
    assert finely - one > one - work(0, 0), "following it again costs more than denser knots"


def test_nothing_is_said_of_what_nobody_has_measured() -> None:
    assert work_of(plate(), RUBBER, FPS, 24, 40, RecoverSettings(schedule="paper")) is None


def test_the_speed_is_measured_by_the_kernels_and_kept_for_this_machine(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "_measured", MEASURED)
    assert known_speed(plastic=False) is None
    measured = measure_speed(plastic=False)
    assert 0.0 < measured.change < measured.copy < measured.base, "a change costs a part of a copy, keeping a run several times as much"
    assert known_speed(plastic=False) == measured and known_speed(plastic=True) is None
    flowing = measure_speed(plastic=True)
    assert known_speed(plastic=True) == flowing and known_speed(plastic=False) == measured
    monkeypatch.setattr(cost, "_machine", lambda: "another")
    assert known_speed(plastic=False) is None


WRONG = ("", "[]", "{", '{"machine": 1}', '{"machine": "here", "elastic": 3}',
         '{"machine": "here", "elastic": {"copy": -1.0, "base": 1.0, "change": 1.0}}')  # fmt: skip


@pytest.mark.parametrize("content", WRONG)
def test_a_damaged_file_tells_nothing_and_is_written_anew(place: Path, content: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "_machine", lambda: "here")
    monkeypatch.setattr(cost, "_measured", lambda plastic: SPEED)
    place.parent.mkdir()
    place.write_text(content)
    assert known_speed(plastic=False) is None
    assert measure_speed(plastic=False) == SPEED == known_speed(plastic=False)


def test_a_place_that_cannot_be_written_stops_nothing(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "_measured", lambda plastic: SPEED)
    place.parent.write_text("a file where the folder should be")
    assert measure_speed(plastic=False) == SPEED and known_speed(plastic=False) is None


def test_the_kernels_of_what_flows_are_others() -> None:
    assert work_of(plate(), CLAY, FPS, 24, 40, RecoverSettings()).plastic
    assert Work(3.0, 2.0, 1.0, False).seconds(Speed(1.0, 10.0, 100.0)) == pytest.approx(cost.OTHER * 123.0)


def test_the_stage_says_it_before_the_solve_and_hands_it_on(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "_measured", lambda plastic: SPEED)
    body, told = held(plate()), []

    def expected(swing: float) -> float:
        x = np.repeat(body.x[None], 9, axis=0)
        x[1:, :, 2] += swing * np.maximum(body.x[:, 0] + 0.05, 0.0)

        def solve(*arguments: object, **more: object) -> None:
            raise Cancelled

        monkeypatch.setattr(stage, "recover", solve)
        take = Take(tmp_path / f"{swing}.take")
        take.prepare()
        with pytest.raises(Cancelled):
            progress = Progress(told.append)
            stage.recover_stage(take, body, RUBBER, points(body, x), FPS, "here", RecoverSettings(), progress)
        return next(one for one in reversed(told) if "expected_seconds" in one)["expected_seconds"]

    near, far = expected(0.1), expected(5.0)
    assert near == pytest.approx(seconds(body, frames=8, points=len(body.x))) and far > 1.2 * near, "what swings far is simulated finely"
    assert "on this machine" in told[-1]["message"]

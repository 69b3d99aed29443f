"""Settings from plain mappings: unknown keys refused, missing keys named."""

from __future__ import annotations

import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.settings import BodyEdit, BuildSettings, Edit, ObserveSettings, from_mapping, to_mapping


def test_a_typing_error_never_runs_with_a_default() -> None:
    with pytest.raises(UsageError, match=r"edit\.toml: unknown setting mass_sclae"):
        from_mapping(BodyEdit, {"name": "a", "mesh": "a.obj", "mass_sclae": 2.0}, "edit.toml")


def test_what_is_missing_is_named() -> None:
    with pytest.raises(UsageError, match="mesh is missing"):
        from_mapping(BodyEdit, {"name": "a"}, "edit.toml")


def test_settings_survive_a_plain_mapping() -> None:
    settings = ObserveSettings(box=(1.0, 2.0, 3.0, 4.0), frames=(2, 9), fps=29.97)
    assert from_mapping(ObserveSettings, to_mapping(settings), "here") == settings
    assert from_mapping(BuildSettings, to_mapping(BuildSettings()), "here") == BuildSettings()


@pytest.mark.parametrize(
    ("wrong", "needs"),
    [
        ({"mass_scale": "2"}, "a finite number"),
        ({"mass_scale": True}, "a finite number"),
        ({"mass_scale": float("nan")}, "a finite number"),
        ({"mass_scale": [1.0]}, "a finite number"),
        ({"material": 5}, "a text"),
        ({"mesh": 5}, "a text"),
        ({"pin": 5}, "a text"),
        ({"velocity": [1.0]}, "a list of 3"),
        ({"velocity": [[1], [2], [3]]}, "a list of 3"),
        ({"start_frame": 1.5}, "a whole number"),
        ({"start_frame": "1"}, "a whole number"),
    ],
)
def test_a_value_of_another_kind_is_refused_by_name(wrong: dict, needs: str) -> None:
    with pytest.raises(UsageError) as caught:
        from_mapping(BodyEdit, {"name": "a", "mesh": "a.obj", **wrong}, "edit.toml")
    assert f"edit.toml: {next(iter(wrong))} is" in caught.value.message and needs in caught.value.hint


@pytest.mark.parametrize(
    "wrong", [{"gravity": [0, 0]}, {"gravity": 5}, {"field_strength": "x"}, {"field_strength": ["a"]}, {"contact": "no"}]
)
def test_an_edit_refuses_them_too(wrong: dict) -> None:
    with pytest.raises(UsageError, match=next(iter(wrong))):
        from_mapping(Edit, {"body": (BodyEdit("a", "a.obj"),), **wrong}, "edit.toml")


def test_whole_numbers_and_lists_stand_for_floats() -> None:
    edit = from_mapping(Edit, {"body": (BodyEdit("a", "a.obj"),), "gravity": [0, 0, -10], "field_strength": [1, 0.5]}, "edit.toml")
    assert edit.gravity == (0, 0, -10) and edit.field_strength == (1, 0.5)


def test_of_a_long_list_the_beginning_is_shown() -> None:
    with pytest.raises(UsageError) as caught:
        from_mapping(Edit, {"body": (), "field_strength": [float("nan")] * 45}, "edit.toml")
    assert caught.value.message.endswith("nan, ... (45 values).") and len(caught.value.message) < 120

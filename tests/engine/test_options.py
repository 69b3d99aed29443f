"""One definition per option: what it refuses, and the command line that comes from it."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from seeing_wind.engine.command.arguments import Parser, parser, settings_of
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.materials import DEFAULT
from seeing_wind.engine.settings import (
    BodyEdit,
    BuildSettings,
    ColliderEdit,
    Edit,
    FieldEdit,
    ObserveSettings,
    RecoverSettings,
    ReportSettings,
    from_mapping,
    options_of,
    words_of,
)
from seeing_wind.engine.settings.option import option

STAGES = (ObserveSettings, BuildSettings, RecoverSettings, ReportSettings)


@dataclass(frozen=True)
class Added:
    """An option as CONTRIBUTING.md adds one."""

    smoothing: float = option(0.5, help="how much it is smoothed", unit="s", minimum=0.0, maximum=2.0, metavar="S", group="the solve")


def test_an_option_is_added_in_one_place() -> None:
    line = Parser(prog="p")
    line.add_settings(Added)
    assert "how much it is smoothed [s] (at least 0 and at most 2; default: 0.5)" in " ".join(line.format_help().split())
    assert settings_of(Added, line.parse_args(words_of(Added(1.25)))) == Added(1.25)
    with pytest.raises(UsageError, match="`--smoothing` must be at least 0 and at most 2 s; this is 3."):
        line.parse_args(["--smoothing", "3"])


def test_words_make_the_same_settings_again() -> None:
    observe = ObserveSettings(fps=29.97, frames=(2, 9), points=(1.0, 2.5, 3e-7, 4.0), depth="d.npy", fov=35.5, prompt="leaf", seed=7)
    build = BuildSettings(material="paper", law="von_mises", density=800.0, poisson_ratio=-0.25, yield_stress=1e-5, particles=90, seed=7)
    solve = RecoverSettings(gravity=(-4.4e-07, 0.0, -1.62), stiffness="given", iterations=3, refine=2, seed=7)
    report = ReportSettings("full")
    words = words_of(observe, build, solve, report)
    assert words.count("--seed") == 1 and "29.97" in words and "2:9" in words
    arguments = parser().parse_args(["recover", "c.mp4", "--take", "t", *words])
    assert [settings_of(cls, arguments) for cls in STAGES] == [observe, build, solve, report]


def test_defaults_need_no_words_and_no_words_make_the_defaults() -> None:
    assert words_of(*(cls() for cls in STAGES)) == []
    arguments = parser().parse_args(["recover", "c.mp4", "--take", "t"])
    assert [settings_of(cls, arguments) for cls in STAGES] == [cls() for cls in STAGES]


@pytest.mark.parametrize("verb", ["observe", "recover"])
def test_every_option_of_a_stage_is_on_the_command_line_once(verb: str) -> None:
    verbs = next(action for action in parser()._actions if action.dest == "verb").choices
    flags = [flag for action in verbs[verb]._actions for flag in action.option_strings]
    for cls in STAGES:
        assert [one.flag for one in options_of(cls).values() if flags.count(one.flag) != 1] == []


@pytest.mark.parametrize(
    ("cls", "wrong", "says"),
    [
        (BodyEdit, {"mass_scale": -1.0}, "here: mass_scale must be above 0; this is -1."),
        (BodyEdit, {"density": 0}, "here: density must be above 0 kg/m³; this is 0."),
        (BodyEdit, {"mass": 1e300}, "here: mass must be at least 1e-09 and at most 1000000000 kg; this is 1e+300."),
        (BodyEdit, {"thickness": 1e-200}, "here: thickness must be at least 1e-06 and at most 1 m; this is 1e-200."),
        (BodyEdit, {"law": "jelly"}, "here: law must be neo_hookean or corotated or von_mises or viscoplastic; this is 'jelly'."),
        (BodyEdit, {"start_frame": -1}, "here: start_frame must be at least 0; this is -1."),
        (ColliderEdit, {"friction": -0.5}, "here: friction must be at least 0; this is -0.5."),
        (ColliderEdit, {"kind": "glue"}, "here: kind must be separate or slip or sticky; this is 'glue'."),
        (RecoverSettings, {"iterations": 1001}, "here: iterations must be at least 1 and at most 1000; this is 1001."),
        (RecoverSettings, {"iterations": 10**400}, "here: iterations must be at least 1 and at most 1000; this is a number of 401 digits."),
    ],
)
def test_a_value_out_of_its_range_is_refused_in_the_words_of_its_definition(cls: type, wrong: dict, says: str) -> None:
    needed = {"name": "a", "mesh": "a.obj"} if cls in (BodyEdit, ColliderEdit) else {}
    with pytest.raises(UsageError) as caught:
        from_mapping(cls, needed | wrong, "here")
    assert caught.value.message == says and caught.value.hint


def test_each_definition_says_what_it_is_and_its_default_keeps_to_it() -> None:
    for cls in (*STAGES, BodyEdit, ColliderEdit, FieldEdit, Edit):
        for one in options_of(cls).values():
            assert one.help and not one.help.endswith("."), one.name
            for value in one.default if isinstance(one.default, tuple) else [one.default]:
                if value is not None:
                    one.check(value, one.name)
            assert one.optional or one.default is not None or one.name in ("name", "mesh", "file"), one.name


def test_what_an_inserted_mesh_is_made_of_is_said() -> None:
    """`resimulate` fills it with the library's default, not with what was recovered."""
    assert f"{DEFAULT} for a mesh" in options_of(BodyEdit)["material"].summary(None)

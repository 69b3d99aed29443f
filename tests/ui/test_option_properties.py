"""The panel's properties come from the engine's options: all are there, hold their values, and are drawn."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

import seeing_wind.ui as ui
from seeing_wind.engine.settings import BodyEdit, BuildSettings, ColliderEdit, Edit, ObserveSettings, RecoverSettings
from seeing_wind.ui.option_properties import give, panel_options, value_of, values_of

STAGES = (ObserveSettings, BuildSettings, RecoverSettings)


@pytest.fixture
def settings(clean_file):
    ui.register()
    yield bpy.context.scene.seeing_wind
    ui.unregister()


def groups(settings) -> list[tuple]:
    body, collider = settings.bodies.add(), settings.colliders.add()
    return [(settings, cls) for cls in (*STAGES, Edit)] + [(body, BodyEdit), (collider, ColliderEdit)]


def test_untouched_properties_stand_for_the_defaults(settings) -> None:
    for group, cls in groups(settings):
        for name, value in values_of(group, cls).items():
            default = cls.__dataclass_fields__[name].default
            assert value == (default if name != "material" else "leaf") or value == pytest.approx(default), name


def test_every_value_goes_in_and_comes_out_again(settings, tmp_path) -> None:
    file = tmp_path / "ä.png"
    file.write_bytes(b"")
    for group, cls in groups(settings):
        for one in panel_options(cls):
            low = one.minimum if one.above is None else one.above
            some = {float: (low or 0.0) + 1.0, int: int(low or 0) + 1, bool: True, str: str(file)}[one.kind]
            value = next(reversed(one.choices)) if one.choices else "paper" if one.name == "material" else some
            value = [value + each for each in range(one.count)] if one.count else value
            give(group, one, value)
            assert value_of(group, one) == (tuple(value) if one.count else value), one.name


def test_options_without_a_place_of_their_own_are_drawn_and_the_others_by_hand(settings) -> None:
    home = Path(ui.__file__).parent
    drawn = "".join(path.read_text(encoding="utf-8") for path in home.rglob("panel.py"))
    for _, cls in groups(settings):
        for one in panel_options(cls, part="main"):
            assert f'"{one.identifier}"' in drawn, one.identifier
    assert {"stiffness", "iterations", "law", "seed"} <= {one.name for one in panel_options(*STAGES, part="more")}
    assert "part=\"more\"" in (home / "clip" / "object" / "panel.py").read_text(encoding="utf-8")

"""The panel's properties come from the engine's options: all are there, hold their values, and are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

import seeing_wind.ui as ui
from seeing_wind.engine.materials import MATERIALS
from seeing_wind.engine.settings import BodyEdit, BuildSettings, ColliderEdit, Edit, ObserveSettings, RecoverSettings
from seeing_wind.engine.settings.option import option
from seeing_wind.ui.clip.object.material_menu import CHOICES, CHOSEN_FOR
from seeing_wind.ui.option_properties import give, panel_options, part_of, value_of, values_of, with_options
from seeing_wind.ui.property_kinds import HEADINGS, MATERIAL_ITEMS
from tests.ui.drawn import Drawn

STAGES = (ObserveSettings, BuildSettings, RecoverSettings)


@pytest.fixture
def settings(clean_file):
    ui.register()
    yield bpy.context.scene.seeing_wind
    ui.unregister()


def groups(settings) -> list[tuple]:
    body, collider = settings.bodies.add(), settings.colliders.add()
    return [(settings, cls) for cls in (*STAGES, Edit)] + [(body, BodyEdit), (collider, ColliderEdit)]


@dataclass(frozen=True)
class Added:
    """Options as CONTRIBUTING.md adds them."""

    smoothing: float = option(0.5, help="how much it is smoothed", unit="s", minimum=0.0, maximum=2.0)
    blur: float | None = option(None, help="how much it is blurred", above=0.0, start=3.0, otherwise="the clip's")


def test_a_property_comes_from_the_definition_alone() -> None:
    group = with_options(Added)(type("SEEING_WIND_PG_added", (bpy.types.PropertyGroup,), {}))
    bpy.utils.register_class(group)
    bpy.types.Scene.seeing_wind_added = bpy.props.PointerProperty(type=group)
    try:
        added = bpy.context.scene.seeing_wind_added
        assert values_of(added, Added) == {"smoothing": 0.5, "blur": None}
        found = added.bl_rna.properties["smoothing"]
        assert (found.name, found.description, found.hard_min, found.hard_max) == ("Smoothing (s)", "How much it is smoothed", 0.0, 2.0)
    finally:
        del bpy.types.Scene.seeing_wind_added
        bpy.utils.unregister_class(group)


def test_tooltips_speak_of_no_flags(settings) -> None:
    for group, _ in groups(settings):
        assert not [prop.identifier for prop in group.bl_rna.properties if "--" in prop.description]


def test_untouched_properties_stand_for_the_defaults(settings) -> None:
    for group, cls in groups(settings):
        for name, value in part_of(values_of(group, cls), cls).items():
            default = cls.__dataclass_fields__[name].default
            assert value == (default if name != "material" else "leaf") or value == pytest.approx(default), name


def test_every_value_goes_in_and_comes_out_again(settings, tmp_path) -> None:
    file = tmp_path / "ä.png"
    file.write_bytes(b"")
    for group, cls in groups(settings):
        for one in panel_options(cls):
            low = one.minimum if one.above is None else one.above
            some = {float: round((low or 0.0) + 1.0, 3), int: int(low or 0) + 1, bool: True, str: str(file)}[one.kind]
            value = next(reversed(one.choices)) if one.choices else "paper" if one.name.endswith("material") else some
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


def test_materials_stand_below_headings_and_keep_their_numbers(settings) -> None:
    items = settings.bl_rna.properties["material"].enum_items
    assert [(item.identifier, item.value) for item in items] == [(name, number) for number, name in enumerate(MATERIALS)]
    listed = [(name, title) for name, title, *_ in MATERIAL_ITEMS]
    assert listed[0] == ("", "Foliage") and [title for name, title in listed if not name] == list(HEADINGS.values())
    assert ("hdpe", "HDPE") in listed and ("plant_stem", "Plant Stem") in listed


@pytest.mark.parametrize("chosen", CHOICES)
def test_each_material_stands_in_the_menu_of_its_kind(settings, chosen) -> None:
    layout, context = Drawn(), SimpleNamespace(**{CHOSEN_FOR: settings})
    getattr(bpy.types, f"SEEING_WIND_MT_{chosen}").draw(SimpleNamespace(layout=layout), context)
    assert len(layout.menus) == len(HEADINGS)
    assert layout.items == ([] if chosen == "material" else ["PRESET"]), "a part may be as the rest"
    below = Drawn()
    for name in layout.menus:
        getattr(bpy.types, name).draw(SimpleNamespace(layout=below), context)
    assert below.items == list(MATERIALS)

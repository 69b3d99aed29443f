"""One wind for several objects of a clip, by the panel's operator."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from seeing_wind.engine.take import Take
from tests.ui.jobs import notes_of, recover

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def two(workplace, tmp_path) -> tuple[Path, Path]:
    """The takes of two objects; the scene shows the winds of both."""
    takes = tmp_path / "leaf.take", tmp_path / "twig.take"
    for take in takes:
        bpy.context.scene.seeing_wind.field = "WIND"
        recover(workplace, take=str(take))
    return takes


def test_the_winds_of_a_scene_become_one(two) -> None:
    leaf, twig = two
    assert bpy.ops.seeing_wind.join() == {"FINISHED"}
    for take in two:
        assert Take(take).read_json("wind.json")["joined"] == ["twig.take", "leaf.take"], "the wind that is shown comes first"
    scene = bpy.context.scene
    field = scene.seeing_wind.field_object
    assert Path(field["seeing_wind_take"]).name == "twig.take" and "seeing_wind_speeds" in field
    assert "delete" in notes_of(scene)[0]


def test_another_take_can_be_named(workplace, two) -> None:
    leaf, twig = two
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.seeing_wind.build_scene(take=str(leaf))
    with pytest.raises(RuntimeError, match="one object only"):
        bpy.ops.seeing_wind.join()
    assert bpy.ops.seeing_wind.join(take=str(twig)) == {"FINISHED"}
    assert Take(twig).read_json("wind.json")["joined"] == ["leaf.take", "twig.take"]

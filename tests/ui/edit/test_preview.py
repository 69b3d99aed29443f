"""A preview of the edit: seen at once, marked, kept apart from the full result, and replaced by it."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.ui import freshness
from seeing_wind.ui.bake.plan import mark_of
from seeing_wind.ui.job import status
from tests.ui.edit.edits import state, written
from tests.ui.jobs import notes_of
from tests.ui.meshes import cube, group, shown

PREVIEW = "out.edit_preview.take"


def insert(name: str = "Box", pinned: bool = True) -> bpy.types.Object:
    """A cube in the edit, held so that it bends."""
    obj = cube(name)
    if pinned:
        group(obj, "Top", {0: 1.0})
    bpy.ops.seeing_wind.insert_mesh(object=obj.name, pin_group="Top" if pinned else "")
    return obj


def previewed() -> list[str]:
    """Bodies that the panel marks as showing a preview."""
    return status.of(bpy.context.scene.session_uid).previewed


def test_a_preview_is_coarser_baked_at_once_and_marked(workplace, recovered) -> None:
    obj = insert()
    recovered.frame_end = 7
    assert bpy.ops.seeing_wind.preview_edit() == {"FINISHED"}
    edit = written(workplace, PREVIEW)
    assert edit["coarseness"] == 2.0 and edit["frames"] == 6, "the clip's frames after the seventh are not seen"
    assert mark_of(obj)["preview"] and not np.allclose(shown(obj, 7), shown(obj, 1))
    assert previewed() == ["Box"] and state("edit_preview") == "done" and state("bake") == "done"
    assert state("resimulate") == "idle" and recovered.seeing_wind.simulated_take == "", "it is not taken for the full result"
    assert not (workplace / "out.edit.take").exists()


def test_the_full_result_replaces_it_by_itself(workplace, recovered) -> None:
    obj = insert()
    recovered.frame_end = 7
    bpy.ops.seeing_wind.preview_edit()
    bpy.ops.seeing_wind.resimulate()
    assert "coarseness" not in written(workplace) and "frames" not in written(workplace)
    assert previewed() == [] and not mark_of(obj)["preview"] and state("bake") == "done" and state("resimulate") == "done"
    assert not np.allclose(shown(obj, 13), shown(obj, 7)), "all frames of the clip"
    with pytest.raises(RuntimeError, match="full result of this edit is there already"):
        bpy.ops.seeing_wind.preview_edit()
    assert state("resimulate") == "done" and state("bake") == "done" and state("edit_preview") == "failed"


def test_a_full_result_is_baked_by_itself_in_place_of_a_preview_only(workplace, recovered) -> None:
    obj = insert()
    bpy.ops.seeing_wind.resimulate()
    assert mark_of(obj) is None and state("bake") == "idle"


def test_a_full_result_is_neither_overwritten_nor_lost(workplace, recovered) -> None:
    obj, settings = insert(), recovered.seeing_wind
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    full, digest = shown(obj, 13), settings.simulated_digest
    before = {path: path.read_bytes() for path in (workplace / "out.edit.take").rglob("*") if path.is_file()}
    bpy.ops.seeing_wind.scale_mass(object="Box", factor=4.0)
    bpy.ops.seeing_wind.preview_edit()
    assert not np.allclose(shown(obj, 13), full) and previewed() == ["Box"] and state("bake") == "done"
    assert settings.simulated_digest == digest and state("resimulate") == "stale"
    assert {path: path.read_bytes() for path in (workplace / "out.edit.take").rglob("*") if path.is_file()} == before
    settings.bodies[0].mass_scale = 1.0
    assert state("resimulate") == "done" and state("bake") == "stale" and previewed() == ["Box"]
    bpy.ops.seeing_wind.bake()
    np.testing.assert_allclose(shown(obj, 13), full, atol=1e-6)
    assert previewed() == [] and state("bake") == "done"


def test_a_preview_goes_stale_with_its_settings_and_with_what_is_seen(workplace, recovered) -> None:
    insert()
    recovered.frame_end = 9
    bpy.ops.seeing_wind.preview_edit()
    for change in (lambda: setattr(recovered, "frame_end", 11), lambda: bpy.ops.seeing_wind.scale_mass(object="Box", factor=2.0)):
        change()
        freshness.refresh(recovered)
        assert state("edit_preview") == "stale" and state("bake") == "stale" and previewed() == ["Box"]
        bpy.ops.seeing_wind.preview_edit()
        assert state("edit_preview") == "done" and state("bake") == "done"
    assert written(workplace, PREVIEW)["frames"] == 10


def test_only_the_frames_that_are_baked_are_simulated(workplace, recovered) -> None:
    insert()
    recovered.seeing_wind.bake_use_frames, recovered.seeing_wind.bake_frames = True, (1, 5)
    bpy.ops.seeing_wind.preview_edit()
    assert written(workplace, PREVIEW)["frames"] == 4
    recovered.seeing_wind.bake_use_frames = False
    recovered.use_preview_range, recovered.frame_preview_end = True, 3
    bpy.ops.seeing_wind.preview_edit()
    assert written(workplace, PREVIEW)["frames"] == 2


def test_clearing_the_bake_takes_the_mark_away_and_baking_shows_the_preview_again(workplace, recovered) -> None:
    obj = insert()
    bpy.ops.seeing_wind.preview_edit()
    moved = shown(obj, 13)
    bpy.ops.seeing_wind.clear_bake()
    assert previewed() == [] and mark_of(obj) is None
    assert bpy.ops.seeing_wind.bake() == {"FINISHED"}
    np.testing.assert_allclose(shown(obj, 13), moved, atol=1e-6)
    assert previewed() == ["Box"], "a bake by hand is marked, too"


def test_an_undo_takes_a_preview_back(workplace, recovered) -> None:
    insert()
    bpy.ops.ed.undo_push(message="Insert")
    bpy.ops.seeing_wind.preview_edit()
    bpy.ops.ed.undo_push(message="Preview")
    bpy.ops.ed.undo()
    assert mark_of(bpy.data.objects["Box"]) is None and previewed() == [] and state("edit_preview") == "idle"
    bpy.ops.ed.redo()
    assert mark_of(bpy.data.objects["Box"])["preview"] and previewed() == ["Box"] and state("edit_preview") == "done"


def test_the_mark_is_saved_with_the_file(workplace, recovered, tmp_path) -> None:
    insert()
    bpy.ops.seeing_wind.preview_edit()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "preview.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "preview.blend"))
    assert previewed() == ["Box"] and state("bake") == "done"


def test_each_edit_has_a_preview_of_its_own(workplace, recovered) -> None:
    insert()
    bpy.ops.seeing_wind.preview_edit()
    bpy.ops.seeing_wind.duplicate_edit()
    settings = recovered.seeing_wind
    assert settings.coarse_take == "" and state("edit_preview") == "idle" and previewed() == []
    bpy.ops.seeing_wind.scale_mass(factor=4.0)
    bpy.ops.seeing_wind.preview_edit()
    assert settings.coarse_take.endswith("out.edit_2_preview.take")
    settings.active_edit = 0
    assert settings.coarse_take.endswith(PREVIEW) and state("edit_preview") == "done" and state("bake") == "done"


def test_what_cannot_be_previewed_is_said(workplace, scene, stand_in, monkeypatch) -> None:
    with pytest.raises(RuntimeError, match="There is no recovered field"):
        bpy.ops.seeing_wind.preview_edit()
    assert state("edit_preview") == "failed" and state("resimulate") == "idle"


def test_failures_of_the_engine_and_of_the_edit_are_told_as_those_of_the_full_one(workplace, recovered, monkeypatch) -> None:
    with pytest.raises(RuntimeError, match="No mesh is inserted"):
        bpy.ops.seeing_wind.preview_edit()
    obj = insert()
    monkeypatch.setenv("SEEING_WIND_FAKE", "die")
    with pytest.raises(RuntimeError, match="SIGKILL"):
        bpy.ops.seeing_wind.preview_edit()
    assert state("edit_preview") == "failed" and mark_of(obj) is None and recovered.seeing_wind.coarse_take == ""
    monkeypatch.delenv("SEEING_WIND_FAKE")
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.seeing_wind.preview_edit() == {"FINISHED"}
    assert any("It is not baked" in note and "Edit Mode" in note for note in notes_of(recovered, "edit_preview"))
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.seeing_wind.bake() == {"FINISHED"} and previewed() == ["Box"]

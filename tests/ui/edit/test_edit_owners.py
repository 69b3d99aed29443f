"""Each .blend file keeps a re-simulation of its own: other versions, other files and other Blenders leave it alone."""

from __future__ import annotations

import json
import os
import socket

import bpy
import pytest

from seeing_wind.ui.job.panel_pieces import draw_job
from tests.ui.drawn import Drawn
from tests.ui.edit.edits import state, written
from tests.ui.meshes import cube


def test_versions_of_a_file_do_not_bake_each_other_s_motion(workplace, recovered) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "a.blend"))
    cube("Falling")
    bpy.ops.seeing_wind.insert_mesh(object="Falling")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.wm.save_mainfile()
    bpy.ops.seeing_wind.scale_mass(factor=8.0)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "a.blend"))
    assert state("resimulate") == "stale"
    draw_job(told := Drawn(), bpy.context, "resimulate", "seeing_wind.resimulate", "Re-simulate", "PLAY")
    assert "another version of this file has simulated its own since: run it again" in " ".join(told.labels).lower()
    with pytest.raises(RuntimeError, match="another version of this file simulated its own"):
        bpy.ops.seeing_wind.bake()
    bpy.ops.seeing_wind.resimulate()
    assert state("resimulate") == "done"
    assert bpy.ops.seeing_wind.bake() == {"FINISHED"}


def test_a_file_saved_under_another_name_leaves_the_former_one_its_motion(workplace, recovered) -> None:
    for name in ("a.blend", "b.blend", "c.blend"):
        (workplace / name).unlink(missing_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "a.blend"))
    cube("Falling")
    bpy.ops.seeing_wind.insert_mesh(object="Falling")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "b.blend"))
    for factor in (8.0, 2.0):  # and keeps to its own
        bpy.ops.seeing_wind.scale_mass(factor=factor)
        bpy.ops.seeing_wind.resimulate()
        assert bpy.context.scene.seeing_wind.simulated_take.endswith("out.edit.2.take")
    bpy.ops.wm.save_mainfile()
    (workplace / "b.blend").rename(workplace / "c.blend")
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "c.blend"))
    bpy.ops.seeing_wind.resimulate()
    assert bpy.context.scene.seeing_wind.simulated_take.endswith("out.edit.2.take"), "a file of another name is the same"
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "a.blend"))
    assert state("resimulate") == "done" and bpy.ops.seeing_wind.bake() == {"FINISHED"}


def test_what_another_file_has_simulated_is_left_alone(workplace, recovered) -> None:
    cube("Mine")
    bpy.ops.seeing_wind.insert_mesh(object="Mine")
    bpy.ops.seeing_wind.resimulate()
    first = recovered.seeing_wind.simulated_take
    bpy.ops.seeing_wind.scale_mass(object="Mine", factor=2.0)
    bpy.ops.seeing_wind.resimulate()
    assert recovered.seeing_wind.simulated_take == first, "the scene's own is renewed"
    before = written(workplace)
    recovered.seeing_wind.owner = "somebody else"
    bpy.ops.seeing_wind.scale_mass(object="Mine", factor=3.0)
    bpy.ops.seeing_wind.resimulate()
    assert recovered.seeing_wind.simulated_take.endswith("out.edit.2.take") and written(workplace) == before


def test_an_edit_that_another_blender_simulates_is_left_alone(workplace, recovered) -> None:
    cube("Mine")
    bpy.ops.seeing_wind.insert_mesh(object="Mine")
    bpy.ops.seeing_wind.resimulate()
    lock, before = workplace / "out.edit.take" / "take.lock", written(workplace)
    bpy.ops.seeing_wind.scale_mass(object="Mine", factor=2.0)
    holder = {"verb": "resimulate", "pid": os.getppid(), "host": socket.gethostname(), "since": "2026-01-01 12:00:00"}
    lock.write_text(json.dumps(holder))
    with pytest.raises(RuntimeError, match="is in use"):
        bpy.ops.seeing_wind.resimulate()
    assert written(workplace) == before
    lock.write_text(json.dumps(holder | {"host": "elsewhere"}))
    bpy.ops.seeing_wind.resimulate()
    assert written(workplace) != before

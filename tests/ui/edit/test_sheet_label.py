"""What the panel says of an open mesh of a thin material."""

from __future__ import annotations

import tomllib
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.materials import SHEETS
from seeing_wind.ui.edit.sheet_label import sheet_words
from tests.ui.jobs import recover
from tests.ui.meshes import cube

pytestmark = pytest.mark.usefixtures("stand_in")

SOLID = "A solid: its mesh is closed. Only an open mesh becomes cloth"


def test_a_grid_of_cotton_weighs_what_cotton_weighs(scene) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=0.8)
    bpy.context.object.name = "Curtain"
    bpy.ops.seeing_wind.insert_mesh(object="Curtain", material="cotton")
    body = scene.seeing_wind.bodies[0]
    assert body.open_area == pytest.approx(0.64)
    assert sheet_words(body) == "Shell, 120 g/m², 76.8 g, 0.35 mm thick"
    body.mass_scale = 2.0
    assert sheet_words(body) == "Shell, 240 g/m², 154 g, 0.35 mm thick"
    body.use_mass, body.mass = True, 0.32
    assert sheet_words(body) == "Shell, 1 kg/m², 640 g, 0.35 mm thick"
    body.use_mass, body.mass_scale, body.material = False, 1.0, "rubber"
    assert sheet_words(body) == ""


def test_scale_and_the_scenes_unit_count(scene) -> None:
    scene.unit_settings.scale_length = 0.01
    bpy.ops.mesh.primitive_plane_add(size=100.0)
    obj = bpy.context.object
    obj.scale = (0.5, 1.0, 1.0)
    bpy.context.view_layer.update()
    bpy.ops.seeing_wind.insert_mesh(object=obj.name, material="silk")
    assert scene.seeing_wind.bodies[0].open_area == pytest.approx(0.5)
    assert sheet_words(scene.seeing_wind.bodies[0]) == f"Shell, 60 g/m², 30 g, {1e3 * SHEETS['silk'].thickness:.2g} mm thick"


def test_a_closed_mesh_is_no_shell(scene) -> None:
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box", material="cotton")
    body = scene.seeing_wind.bodies[0]
    assert sheet_words(body) == SOLID
    body.material = "rubber"
    assert sheet_words(body) == "", "that is plain"


def test_a_mesh_that_is_closed_but_for_repeated_vertices_is_no_shell(scene) -> None:
    """As many files have it; the engine joins them, too."""
    box = cube("Box")
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.edge_split()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(box.data.vertices) == 24
    bpy.ops.seeing_wind.insert_mesh(object="Box", material="cotton")
    assert sheet_words(scene.seeing_wind.bodies[0]) == SOLID


def test_what_is_mended_in_edit_mode_is_seen_there(scene) -> None:
    import bmesh  # comes with bpy, and only after it

    box = cube("Sail")
    bpy.ops.seeing_wind.insert_mesh(object="Sail", material="cotton")
    body = scene.seeing_wind.bodies[0]
    bpy.ops.object.mode_set(mode="EDIT")
    edited = bmesh.from_edit_mesh(box.data)
    edited.faces.ensure_lookup_table()
    edited.faces.remove(edited.faces[0])
    loose = edited.verts.new((0.0, 0.0, 1.0))
    bmesh.update_edit_mesh(box.data)
    bpy.context.view_layer.update()
    assert body.no_sheet.startswith("Sail has 1 loose vertex") and body.open_area == pytest.approx(0.2)
    box.name = "Jib"
    bpy.context.view_layer.update()
    assert body.no_sheet.startswith("Jib has 1 loose vertex"), "the name is the present one"
    edited.verts.remove(loose)
    bmesh.update_edit_mesh(box.data)
    bpy.context.view_layer.update()
    assert body.no_sheet == "" and sheet_words(body).startswith("Shell, 120 g/m²")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert body.no_sheet == "" and sheet_words(body).startswith("Shell, 120 g/m²")


def test_a_sheets_own_numbers_reach_the_edit_and_a_solid_has_none(scene, workplace) -> None:
    recover(workplace)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=2, size=0.5)
    bpy.context.object.name = "Curtain"
    bpy.ops.seeing_wind.insert_mesh(object="Curtain", material="cotton")
    body = scene.seeing_wind.bodies[0]
    body.use_areal_density, body.areal_density, body.use_thickness, body.thickness = True, 0.4, True, 5e-4
    body.use_bending_stiffness, body.bending_stiffness = True, 2e-5
    assert sheet_words(body) == "Shell, 400 g/m², 100 g, 0.5 mm thick"
    entries = []
    for material in ("cotton", "rubber"):
        body.material = material
        assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
        entries += tomllib.loads((Path(scene.seeing_wind.simulated_take) / "edit.toml").read_text())["body"]
    assert [entries[0][name] for name in ("areal_density", "thickness", "bending_stiffness")] == pytest.approx([0.4, 5e-4, 2e-5])
    assert "areal_density" not in entries[1] and "tensile_stiffness" not in entries[0]


def test_the_weight_follows_the_object_as_it_is(scene) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=0.8)
    curtain = bpy.context.object
    bpy.ops.seeing_wind.insert_mesh(object=curtain.name, material="cotton")
    body = scene.seeing_wind.bodies[0]
    curtain.scale = (2.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    assert sheet_words(body) == "Shell, 120 g/m², 154 g, 0.35 mm thick"
    rig = bpy.data.objects.new("Rig", None)
    scene.collection.objects.link(rig)
    curtain.parent, rig.scale = rig, (0.5, 0.5, 0.5)
    bpy.context.view_layer.update()
    assert body.open_area == pytest.approx(0.32), "in the world"
    for vertex in curtain.data.vertices:
        vertex.co.x *= 3.0
    curtain.data.update_tag()
    bpy.context.view_layer.update()
    assert body.open_area == pytest.approx(0.96)
    bpy.ops.mesh.primitive_cube_add()
    body.object = bpy.context.object
    assert sheet_words(body) == SOLID, "another mesh, which is closed"


def insert_grid(name: str, preset: str) -> bpy.types.Object:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=2, size=2.0, rotation=(0.5 * np.pi, 0.0, 0.0))
    obj = bpy.context.object
    obj.name = name
    bpy.ops.seeing_wind.insert_mesh(object=name, material=preset)
    return obj


def brightness(scene, path: Path) -> float:
    """Of the frame's middle, linear, as Cycles renders it."""
    scene.render.engine, scene.cycles.samples, scene.view_settings.view_transform = "CYCLES", 16, "Raw"
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.filepath = str(path)
    scene.render.image_settings.file_format = "OPEN_EXR"
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    return float(np.mean(np.array(image.pixels[:]).reshape(8, 8, 4)[2:6, 2:6, 1]))


def test_cloth_without_a_material_gets_one_that_the_sun_shines_through(scene, tmp_path) -> None:
    """A camera before the cloth, a sun behind it: so much of the light as is said, less for heavy cloth, none for what is no cloth."""
    camera = scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0.0, -2.0, 0.0), (0.5 * np.pi, 0.0, 0.0)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    scene.collection.objects.link(sun)
    sun.data.energy, sun.rotation_euler = np.pi, (-0.5 * np.pi, 0.0, 0.0)
    seen = {}
    for preset in ("cotton", "denim", "paper"):
        obj = insert_grid(preset.title(), preset)
        seen[preset] = brightness(scene, tmp_path / f"{preset}.exr")
        obj.hide_render = True
    assert [each.name for each in bpy.data.materials if each.users] == ["Seeing Wind Cotton", "Seeing Wind Denim"]
    assert 0.2 < seen["cotton"] < 0.35 and 0.02 < seen["denim"] < 0.1 and seen["paper"] < 0.01


def test_a_material_of_the_users_stays(scene, capfd) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=2)
    own = bpy.data.materials.new("Mine")
    bpy.context.object.data.materials.append(own)
    bpy.ops.seeing_wind.insert_mesh(object="Grid", material="cotton")
    assert list(bpy.data.objects["Grid"].data.materials) == [own] and "thin cloth" not in capfd.readouterr().out
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box", material="cotton")
    assert not len(bpy.data.objects["Box"].data.materials)
    assert all(face.use_smooth for face in insert_grid("Other", "cotton").data.polygons)
    assert "Other had no material and looks like thin cloth now" in capfd.readouterr().out

"""What the panel says of an open mesh of a thin material."""

from __future__ import annotations

import bpy
import pytest

from seeing_wind.engine.materials import SHEETS
from seeing_wind.ui.edit.sheet_label import shell_words
from tests.ui.jobs import cube

pytestmark = pytest.mark.usefixtures("stand_in")


def test_a_grid_of_cotton_weighs_what_cotton_weighs(scene) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=0.8)
    bpy.context.object.name = "Curtain"
    bpy.ops.seeing_wind.insert_mesh(object="Curtain", material="cotton")
    body = scene.seeing_wind.bodies[0]
    assert body.open_area == pytest.approx(0.64)
    assert shell_words(body) == "Shell, 0.12 kg/m², 0.0768 kg"
    body.mass_scale = 2.0
    assert shell_words(body) == "Shell, 0.24 kg/m², 0.154 kg"
    body.use_mass, body.mass = True, 0.32
    assert shell_words(body) == "Shell, 1 kg/m², 0.64 kg"
    body.use_mass, body.mass_scale, body.material = False, 1.0, "rubber"
    assert shell_words(body) == ""


def test_scale_and_the_scenes_unit_count(scene) -> None:
    scene.unit_settings.scale_length = 0.01
    bpy.ops.mesh.primitive_plane_add(size=100.0)
    obj = bpy.context.object
    obj.scale = (0.5, 1.0, 1.0)
    bpy.context.view_layer.update()
    bpy.ops.seeing_wind.insert_mesh(object=obj.name, material="silk")
    assert scene.seeing_wind.bodies[0].open_area == pytest.approx(0.5)
    assert shell_words(scene.seeing_wind.bodies[0]) == f"Shell, {SHEETS['silk'].areal_density:g} kg/m², 0.03 kg"


def test_a_closed_mesh_is_no_shell(scene) -> None:
    cube("Box", scene)
    bpy.ops.seeing_wind.insert_mesh(object="Box", material="cotton")
    assert shell_words(scene.seeing_wind.bodies[0]) == ""

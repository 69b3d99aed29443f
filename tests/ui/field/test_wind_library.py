"""Winds that come with the extension: a shelf of two made-up ones, taken into a clean file."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.display import KIND, arrows_of, lacks_arrows
from seeing_wind.ui.field.library import shelf
from seeing_wind.ui.field.samples import read_samples, samples_of
from seeing_wind.ui.scene_units import METRES, said_of_units

ROOT = Path(__file__).resolve().parents[3]
CHECK = runpy.run_path(str(ROOT / "tests" / "blender" / "wind_check.py"), run_name="checks")
NAMES = ("Light Breeze", "Passing Gust")
NODES = np.stack(np.meshgrid(*3 * [np.linspace(-1.0, 1.0, 3)], indexing="ij"), axis=-1).reshape(-1, 3)
SPEEDS = np.array([1.0, 2.0, 3.0, 4.0])
"""Along X [m/s], by frame."""

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture(scope="module")
def takes(tmp_path_factory) -> Path:
    """What make.py leaves of two winds."""
    folder = tmp_path_factory.mktemp("takes")
    for name in NAMES:
        take = folder / name.replace(" ", "_").lower() / "wind.take"
        take.mkdir(parents=True)
        law = {"air_density": 1.2, "normal": 1.17}
        told = {"field": "wind", "notes": [], "mean_speed": 2.5, "strongest_gust": 4.0, "drag_law": law}
        (take / "wind.json").write_text(json.dumps(told))
        wind = np.zeros((4, len(NODES), 3))
        wind[..., 0] = SPEEDS[:, None]
        np.savez(
            take.parent / "on_the_shelf.npz", nodes=NODES, density=30.0, off=np.array([1.0, 2.0]), wind_velocity=wind,
            force_density=20.0 * wind, wind_confidence=np.zeros(wind.shape[:2]),  # as away from the plate's path
        )  # fmt: skip
    return folder


@pytest.fixture
def library(takes, tmp_path, monkeypatch) -> Path:
    """The shelf that the scene's own script makes of them."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    main = runpy.run_path(str(ROOT / "sample_scenes" / "winds" / "shelve.py"), run_name="shelve")["main"]
    main(tmp_path / "shelf", takes, list(NAMES))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    monkeypatch.setattr(shelf, "SHELF", tmp_path / "shelf")
    return tmp_path / "shelf"


def test_a_wind_taken_into_a_clean_file_moves_particles_and_goes_round(library) -> None:
    scene = bpy.context.scene
    dust = CHECK["dust"](scene)
    scene.frame_start, scene.render.fps = 101, 24
    dust.particle_systems[0].settings.frame_start = dust.particle_systems[0].settings.frame_end = 101
    dust.particle_systems[0].point_cache.frame_start, dust.particle_systems[0].point_cache.frame_end = 101, 200
    scene.frame_end = 200
    assert bpy.ops.seeing_wind.add_wind(wind="Light Breeze") == {"FINISHED"}
    field = scene.objects["Light Breeze"]
    assert bpy.context.active_object == field and field.asset_data is None and field["seeing_wind_loop"]
    assert [each.object for each in scene.seeing_wind.calibrations] == [dust]
    speeds = []
    for frame in range(101, 131):
        scene.frame_set(frame)
        system = dust.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
        speeds.append(np.mean([particle.velocity[0] for particle in system.particles]))
    assert 0.5 < speeds[29] < 4.0, "slow for these grains' mass, but blown"
    seen = [felt(field, frame) for frame in range(102, 110)]
    assert seen == pytest.approx([*SPEEDS, *SPEEDS], rel=1e-4)
    field["seeing_wind_loop"] = False
    field.update_tag()
    assert felt(field, 109) == pytest.approx(SPEEDS[-1], rel=1e-4), "without the loop the last frame stays"


def felt(field: bpy.types.Object, frame: int) -> float:
    """The speed that Geometry Nodes find in a frame [m/s]."""
    samples = samples_of(field)
    if samples.name not in bpy.context.scene.objects:
        bpy.context.scene.collection.objects.link(samples)
    samples.hide_viewport = False  # Blender evaluates nothing that is hidden and unused
    bpy.context.scene.frame_set(frame)
    values = samples.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.attributes["velocity"].data
    return values[0].vector[0]


def test_solvers_go_round_with_geometry_nodes(library) -> None:
    """A particle let go in each frame gets that clip frame's push: as strong in the second round as in the first."""
    scene = bpy.context.scene
    scene.render.fps, scene.use_gravity = 24, False
    bpy.ops.seeing_wind.add_wind(wind="Light Breeze", calibrate=False)
    pushed = []
    for frame in (1, 2, 3, 4, 5, 6):
        dust = CHECK["dust"](scene)
        scene.render.fps = 24
        settings = dust.particle_systems[0].settings
        settings.frame_start = settings.frame_end = frame
        bpy.ops.seeing_wind.calibrate(object=dust.name, field="Light Breeze")
        for now in range(frame, frame + 2):
            scene.frame_set(now)
        system = dust.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
        pushed.append(np.mean([particle.velocity[0] for particle in system.particles]))
        bpy.data.objects.remove(dust)
    assert np.array(pushed) / pushed[0] == pytest.approx([1.0, 2.0, 3.0, 4.0, 1.0, 2.0], rel=0.02)


def test_a_wind_of_the_library_goes_into_vdb_files_beside_the_scene(library, tmp_path, monkeypatch) -> None:
    written: list[Path] = []
    monkeypatch.setattr("seeing_wind.ui.field.vdb.write_vdb", lambda scene, field, folder: written.append(folder) or [])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert bpy.ops.seeing_wind.add_wind() == {"FINISHED"} and bpy.ops.seeing_wind.export_field(format="VDB") == {"FINISHED"}
    assert [folder.parent for folder in written] == [tmp_path]
    with pytest.raises(RuntimeError, match="without its take, which PLY"):
        bpy.ops.seeing_wind.export_field(format="PLY")


def test_a_wind_is_no_body_and_no_obstacle(library) -> None:
    assert bpy.ops.seeing_wind.add_wind() == {"FINISHED"} and bpy.context.active_object is not None
    for insert in (bpy.ops.seeing_wind.insert_mesh, bpy.ops.seeing_wind.insert_collider):
        with pytest.raises(RuntimeError, match="No mesh is selected|no mesh to collide"):
            insert()


def arrows_seen(field: bpy.types.Object, frame: int) -> np.ndarray:
    """Corners (V, 3) of the arrows of a field as they are drawn in a frame; the bare vertex that names their colors left out."""
    bpy.context.scene.frame_set(frame)
    arrows = arrows_of(field, bpy.context.scene)
    mesh = arrows.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return np.array([arrows.matrix_world @ vertex.co for vertex in mesh.vertices if len(mesh.polygons)])[1:]


def test_a_wind_shows_its_arrows_which_go_with_it(library) -> None:
    scene = bpy.context.scene
    scene.render.fps = 24
    assert bpy.ops.seeing_wind.add_wind(wind="Light Breeze") == {"FINISHED"}
    field = scene.objects["Light Breeze"]
    arrows = arrows_of(field, scene)
    assert arrows.hide_render and arrows["seeing_wind_units"] == "m/s" and arrows["seeing_wind_peak"] == pytest.approx(SPEEDS[-1])
    lengths = [np.ptp(arrows_seen(field, frame)[:, 0]) for frame in (1, 4, 5, 8)]
    assert lengths[1] > lengths[0] + 0.05 and lengths[2:] == pytest.approx(lengths[:2]), "longer in a stronger wind, and round again"
    before = arrows_seen(field, 1)
    field.location, field.rotation_euler.z = (5.0, 0.0, 0.0), 0.5 * np.pi
    bpy.context.view_layer.update()
    turned = before @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + [5.0, 0.0, 0.0]
    assert arrows_seen(field, 1) == pytest.approx(turned, abs=1e-5)
    bpy.context.view_layer.objects.active = arrows
    arrows.select_set(True)
    with pytest.raises(RuntimeError, match="No mesh is selected"):
        bpy.ops.seeing_wind.insert_mesh()


def test_a_wind_that_was_dragged_or_appended_gets_its_arrows_once(library, monkeypatch) -> None:
    registered: list = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda function, **_: registered.append(function))
    scene = bpy.context.scene
    bpy.ops.wm.append(directory=f"{library / shelf.BLEND}/Object/", filename="Passing Gust")
    field = scene.objects["Passing Gust"]
    field.location.z = 2.0
    bpy.context.view_layer.update()
    assert arrows_of(field, scene) is None and registered[-1]() is None
    arrows = arrows_of(field, scene)
    assert len(arrows_seen(field, 2)) and not lacks_arrows(field)
    for obj in scene.objects:
        obj.select_set(obj == field)
    bpy.context.view_layer.objects.active = field
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    bpy.context.view_layer.update()
    assert registered[-1]() is None and arrows_of(copy, scene) not in (None, arrows) and arrows_of(field, scene) == arrows
    bpy.data.objects.remove(arrows)
    bpy.context.view_layer.update()
    registered[-1]()
    assert arrows_of(field, scene) is None, "deleted by the user, they stay away"
    left, values = arrows_of(copy, scene).name, samples_of(copy).name
    with bpy.context.temp_override(selected_objects=[copy]):
        bpy.ops.object.delete()
    bpy.context.view_layer.update()
    registered[-1]()
    assert left not in bpy.data.objects and left not in bpy.data.meshes, "those of a deleted wind go with it"
    assert values not in bpy.data.objects and values not in bpy.data.meshes, "and what a copy carried"
    assert read_samples(samples_of(field)).velocity[:, 0, 0] == pytest.approx(SPEEDS), "the first wind keeps its own"
    values = samples_of(field).name
    assert values in scene.objects, "Blender's Append puts it there"
    with bpy.context.temp_override(selected_objects=[field]):
        bpy.ops.object.delete()
    bpy.context.view_layer.update()
    registered[-1]()
    assert not scene.objects and values not in bpy.data.objects


def test_a_wind_goes_by_at_its_own_speed_and_what_it_carries_is_whole(library) -> None:
    scene = bpy.context.scene
    scene.render.fps, scene.cursor.location = 48, (1.0, 2.0, 3.0)
    bpy.ops.seeing_wind.add_wind(wind="Passing Gust")
    field = scene.objects["Passing Gust"]
    assert field["seeing_wind_stride"] == 2.0 and tuple(field.location) == (1.0, 2.0, 3.0) and not field["seeing_wind_loop"]
    assert read_samples(samples_of(field)).velocity[:, 0, 0] == pytest.approx(SPEEDS)
    with pytest.raises(TypeError, match="not found"):
        bpy.ops.seeing_wind.add_wind(wind="Hurricane")


@pytest.mark.parametrize("noted", [True, False], ids=["made now", "by an earlier version"])
@pytest.mark.parametrize("how", ["added", "appended"])
def test_a_wind_is_the_same_in_a_scene_of_another_unit(library, monkeypatch, how, noted) -> None:
    """In centimetres, box, wind, force, arrows and what particles feel are those of a scene in metres."""
    if not noted:
        bpy.ops.wm.open_mainfile(filepath=str(library / shelf.BLEND))
        for obj in bpy.data.objects:
            if METRES in obj:
                del obj[METRES]
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.read_factory_settings(use_empty=True)
    timers: list = []
    monkeypatch.setattr(bpy.app.timers, "register", lambda function, **_: timers.append(function))
    found = []
    for unit in (1.0, 0.01):
        scene = bpy.data.scenes.new("Shot")
        bpy.context.window.scene = scene
        scene.unit_settings.scale_length, scene.render.fps, scene.use_gravity = unit, 24, False
        scene.cursor.location = (1.0 / unit, 0.0, 0.0)
        if how == "added":
            bpy.ops.seeing_wind.add_wind(wind="Light Breeze", calibrate=False)
            field = bpy.context.active_object
        else:
            bpy.ops.wm.append(directory=f"{library / shelf.BLEND}/Object/", filename="Light Breeze")
            field = next(obj for obj in scene.objects if KIND in obj)
            field.location.x = 1.0 / unit
            bpy.context.view_layer.update()
            timers[-1]()
        assert said_of_units(field, scene) == "" and samples_of(field).parent == field
        values, arrows = read_samples(samples_of(field)), arrows_of(field, scene)
        found.append({
            "box": unit * np.array([vertex.co for vertex in field.data.vertices]), "place": unit * np.array(field.location),
            "arrows": unit * arrows_seen(field, 4),
            "nodes": unit * values.points, "wind": unit * values.velocity, "force": unit * values.force,
            "sure": values.confidence, "peak": arrows["seeing_wind_peak"], "felt": unit * felt(field, 3),
            "pushed": unit * pushed(scene, field, unit),
        })  # fmt: skip
    for name, in_metres in found[0].items():
        np.testing.assert_allclose(found[1][name], in_metres, rtol=1e-3, atol=1e-5, err_msg=name)
    assert found[0]["felt"] == pytest.approx(SPEEDS[1]) and found[0]["pushed"] > 0.01


def test_a_wind_follows_a_later_change_of_the_unit_when_it_is_applied(library) -> None:
    scene = bpy.context.scene
    bpy.ops.seeing_wind.add_wind(wind="Light Breeze", calibrate=False)
    field = bpy.context.active_object
    shown, said = arrows_seen(field, 4), "Press Apply to Field in the Field panel to convert it, or set Unit Scale to 1"
    scene.unit_settings.scale_length = 0.01
    assert said in said_of_units(field, scene)
    assert bpy.ops.seeing_wind.apply_to_field() == {"FINISHED"} and said_of_units(field, scene) == ""
    assert felt(field, 3) == pytest.approx(100.0 * SPEEDS[1], rel=1e-3)
    np.testing.assert_allclose(arrows_seen(field, 4), 100.0 * shown, rtol=1e-3, atol=1e-3)
    assert sum(obj.name.startswith("Light Breeze Arrows") for obj in scene.objects) == 1


def pushed(scene: bpy.types.Scene, field: bpy.types.Object, unit: float) -> float:
    """Speed along X [scene units/s] of a calibrated particle that was let go in the middle of a wind, after two frames."""
    mesh = bpy.data.meshes.new("Dust")
    mesh.from_pydata([(0.0, 0.0, 0.0)], [], [])
    dust = bpy.data.objects.new("Dust", mesh)
    scene.collection.objects.link(dust)
    dust.location = field.location
    settings = dust.modifiers.new("Dust", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.emit_from, settings.frame_start, settings.frame_end, settings.normal_factor = 1, "VERT", 1, 1, 0.0
    settings.particle_size = 0.01 / unit
    bpy.ops.seeing_wind.calibrate(object=dust.name, field=field.name)
    for frame in (1, 2, 3):
        scene.frame_set(frame)
    return dust.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0].particles[0].velocity[0]


def test_assets_have_catalogs_tags_previews_and_the_browser_lists_them(library) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(library / shelf.BLEND))
    catalogs = {line.split(":")[0]: line.split(":")[1] for line in (library / shelf.CATALOGS).read_text().splitlines() if ":" in line}
    for name, catalog in zip(NAMES, ("Breezes", "Gusts"), strict=True):
        obj = bpy.data.objects[name]
        about = obj.asset_data
        assert catalogs[about.catalog_id] == f"Recovered Winds/{catalog}" and "wind" in [tag.name for tag in about.tags]
        assert "2.5 m/s (Beaufort 2)" in about.description and "1 % and 2°" in about.description
        pixels = np.array(obj.preview.image_pixels_float[:]).reshape(-1, 4)
        assert obj.preview.image_size[:] == (192, 192) and np.ptp(pixels[:, :3]) > 0.5
    libraries = bpy.context.preferences.filepaths.asset_libraries
    before = len(libraries)
    for _ in range(2):
        assert bpy.ops.seeing_wind.add_wind_library() == {"FINISHED"}
    assert len(libraries) == before + 1 and Path(shelf.listed().path) == library and shelf.listed().import_method == "APPEND"


def test_breezes_and_gusts_blow_everywhere_and_the_others_end_beside_their_boxes() -> None:
    """Of the files that come with the extension, as docs/reference/units.md says."""
    catalogs = {each.name: each.catalog for each in shelf.entries(shelf.SHELF)}
    with bpy.data.libraries.load(str(shelf.SHELF / shelf.BLEND)) as (_, wanted):
        wanted.objects = list(catalogs)
    reaches = {obj.name: obj["seeing_wind_reach"] for obj in wanted.objects}
    assert reaches == {name: "HOLD" if catalog in ("Breezes", "Gusts") else "FADE" for name, catalog in catalogs.items()}
    said = " ".join((ROOT / "docs" / "reference" / "units.md").read_text(encoding="utf-8").split())
    assert "Its breezes and gusts blow everywhere and come with *Hold*; the others come with *Fade*" in said


def test_a_copy_without_a_library_says_so(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(shelf, "SHELF", tmp_path)
    with pytest.raises(RuntimeError, match="no wind library"):
        bpy.ops.seeing_wind.add_wind_library()
    (tmp_path / shelf.INDEX).write_text('{"name": 3}')
    shelf.entries.cache_clear()
    with pytest.raises(RuntimeError, match="damaged"):
        bpy.ops.seeing_wind.add_wind_library()


def test_what_solvers_feel_is_chosen_for_each_wind_by_itself(library) -> None:
    settings = bpy.context.scene.seeing_wind
    assert bpy.ops.seeing_wind.add_wind(wind=NAMES[0]) == {"FINISHED"}
    first = bpy.context.object
    came = (first["seeing_wind_reach"], first[KIND])
    assert (settings.field_reach, settings.field_kind) == came, "as it is: nothing is to be applied"
    bpy.ops.seeing_wind.add_wind(wind=NAMES[1])
    second = bpy.context.object
    settings.field_reach, settings.field_kind = "CONTINUE", "FORCE"
    assert bpy.ops.seeing_wind.apply_to_field() == {"FINISHED"}
    assert (second["seeing_wind_reach"], second[KIND]) == ("CONTINUE", "FORCE")
    second.select_set(False)
    bpy.context.view_layer.objects.active = first
    first.select_set(True)
    assert (settings.field_reach, settings.field_kind) == came == (first["seeing_wind_reach"], first[KIND])
    assert settings.own_reach == "FADE", "that of the next recovery stays"

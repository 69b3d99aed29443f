"""Results on a medium or a share that nobody can write to: they are looked at; what must write says where it cannot, and what to do."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import os
import shutil
import tempfile
from pathlib import Path

import bpy
import pytest

from seeing_wind.engine.errors import TakeError
from seeing_wind.engine.masks import Masks
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Camera
from seeing_wind.engine.take import Take, npz
from seeing_wind.ui.clip.inputs.mask import png
from seeing_wind.ui.composite.mattes import FOLDER, matte
from tests.ui.jobs import recover
from tests.ui.meshes import cube

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def shelf(workplace, tmp_path, monkeypatch) -> Path:
    """A folder with a take, out.take, that this process cannot write to: no mode of a folder binds it where it is root's."""
    folder = tmp_path / "shelf"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    recover(workplace, take=str(folder / "out.take"))
    for path in (folder / "out.take").glob("blender_*"):
        path.unlink()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    temporary_file, writing = tempfile.TemporaryFile, Take.writing

    def asked_for(*arguments, dir=None, **options):
        if folder in (Path(dir), *Path(dir).parents):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return temporary_file(*arguments, dir=dir, **options)

    @contextlib.contextmanager
    def refused(take, name):
        if folder in take.file(name).absolute().parents:
            raise TakeError(f"Cannot write {take.file(name)}: Read-only file system.", "Choose another folder.")
        with writing(take, name) as aside:
            yield aside

    monkeypatch.setattr(tempfile, "TemporaryFile", asked_for)
    monkeypatch.setattr(Take, "writing", refused)
    return folder


def held(folder: Path) -> dict[Path, int]:
    """All that is in a folder, and when it was changed."""
    return {path: path.stat().st_mtime_ns for path in sorted(folder.rglob("*"))}


def test_results_are_loaded_from_a_read_only_folder(shelf, tmp_path) -> None:
    before, ops = held(shelf), bpy.ops.seeing_wind
    for _ in range(2):
        assert ops.build_scene(take=str(shelf / "out.take")) == {"FINISHED"}
    settings = bpy.context.scene.seeing_wind
    assert settings.field_object.field.type == "TEXTURE" and settings.arrows_object["seeing_wind_peak"] > 0.0
    assert settings.recovered_object.data.shape_keys and settings.recovered_take == str(shelf / "out.take")
    bpy.ops.mesh.primitive_grid_add(size=0.5)
    bpy.context.object.modifiers.new("Cloth", "CLOTH")
    assert ops.calibrate() == {"FINISHED"} == ops.apply_to_field()
    assert ops.export_field(format="NPZ", filepath=str(tmp_path / "wind.npz")) == {"FINISHED"}
    assert held(shelf) == before


@pytest.mark.parametrize("bent", [False, True])
def test_a_composite_whose_images_cannot_be_written_changes_nothing(shelf, bent) -> None:
    scene, ops, take = bpy.context.scene, bpy.ops.seeing_wind, Take(shelf / "out.take")
    if bent:  # its outlines are written already, the map of its lens is not
        seen = take.read_arrays("observation.npz")
        camera = dataclasses.replace(from_arrays(Camera, seen, "camera."), distortion=(-1.0, 0.2, 0.0, 0.0, 0.0))
        (take.path / "observation.npz").write_bytes(npz("observation.npz", seen | to_arrays(camera, "camera.")))
        (take.path / FOLDER).mkdir()
        for t, mask in enumerate(from_arrays(Masks, seen, "masks.")):
            (take.path / FOLDER / f"matte_{t + 1:04}.png").write_bytes(png(matte(mask)))
    ops.build_scene(take=str(take.path))
    before = held(shelf)
    kept = scene.render.engine, scene.cycles.samples, scene.render.film_transparent, scene.camera.data.show_background_images
    with pytest.raises(RuntimeError, match=rf"{take.path}\S* cannot be written: Read-only .*put a copy of out.take beside it"):
        ops.set_up_composite()
    assert kept == (scene.render.engine, scene.cycles.samples, scene.render.film_transparent, scene.camera.data.show_background_images)
    assert held(shelf) == before and not scene.seeing_wind.composite_said


def test_what_writes_beside_a_read_only_take_says_so_and_goes_on_with_a_copy(shelf, workplace, tmp_path) -> None:
    before, ops, take = held(shelf), bpy.ops.seeing_wind, shelf / "out.take"
    ops.build_scene(take=str(take))
    cube("Box")
    ops.insert_mesh(object="Box")
    for call in (ops.resimulate, ops.preview_edit):
        with pytest.raises(RuntimeError, match=rf"{shelf} cannot be written: Read-only .*put a copy of out.take beside it"):
            call()
    for folder in (take, shelf / "new" / "other.take"):
        with pytest.raises(RuntimeError, match=rf"{shelf}\S* cannot be written: Read-only file system. Choose another Take"):
            recover(workplace, take=str(folder))
    assert held(shelf) == before
    (tmp_path / "project").mkdir()
    shutil.copytree(take, tmp_path / "project" / "out.take")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "shot.blend"))
    assert ops.resimulate() == {"FINISHED"} == ops.bake()
    assert Path(bpy.context.scene.seeing_wind.simulated_take).parent == tmp_path / "project" and held(shelf) == before

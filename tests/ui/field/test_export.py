"""Files for other programs: where they go, what is told of them, and a disk that is full."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.engine.errors import TakeError
from seeing_wind.ui.field import operators
from seeing_wind.ui.field.display import openvdb_available
from seeing_wind.ui.field.vdb import write_file
from seeing_wind.ui.job.worker_command import command


class Grid:
    """In the place of OpenVDB's, which the wheels of `bpy` have not."""

    name = "force"

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def copyToArray(self, array: np.ndarray) -> None:  # noqa: N802
        array[...] = self.values


class Vdb:
    """In the place of its module: writes without a word as much as there is room for."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, path: str, grids: list[Grid]) -> None:
        Path(path).write_bytes(grids[0].values.tobytes()[: self.room])

    def readAll(self, path: str) -> tuple[list[Grid], dict]:  # noqa: N802
        found = Path(path).read_bytes()
        if not found:
            raise LookupError("Cannot read grid.")
        return [Grid(np.frombuffer(found.ljust(96, b"\0"), np.float32).reshape(2, 4, 3))], {}


@pytest.fixture(autouse=True)
def recovered(recovered_file, stand_in) -> None:
    """A field recovered, in the file that has it."""
    bpy.ops.wm.open_mainfile(filepath=str(recovered_file))


@pytest.mark.parametrize(
    ("room", "says"), [(0, "OpenVDB cannot read it again: Cannot read grid"), (60, "does not hold what it should of force")]
)
def test_half_a_vdb_file_is_told_and_not_kept(tmp_path, monkeypatch, room, says) -> None:
    values = np.random.default_rng(0).normal(size=(2, 4, 3)).astype(np.float32)
    path = write_file(tmp_path / "wind_0002.vdb", [(Grid(values), values)], Vdb(96))
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10**12, 10**12 - 5 * 10**9, 5 * 10**9))
    with pytest.raises(TakeError) as raised:
        write_file(path, [(Grid(-values), -values)], Vdb(room))
    assert raised.value.message == f"{path} was written, but {says}."
    assert raised.value.hint.startswith("5 GB are free on that disk: make room if that is too little, or choose another folder")
    assert path.read_bytes() == values.tobytes() and list(tmp_path.iterdir()) == [path], "the former one is whole"


def test_what_openvdb_says_is_told_where_nobody_knows_how_full_the_disk_is(tmp_path, monkeypatch) -> None:
    def disk_usage(folder):
        raise OSError("gone")

    def write(path, grids):
        raise RuntimeError(f"IoError: {path} is not writable")

    broken, path = Vdb(96), tmp_path / "wind_0002.vdb"
    monkeypatch.setattr(shutil, "disk_usage", disk_usage)
    monkeypatch.setattr(broken, "write", write)
    with pytest.raises(TakeError) as raised:
        write_file(path, [(Grid(np.zeros(24)), np.zeros(24))], broken)
    assert raised.value.message == f"OpenVDB cannot write {path}: IoError: {path} is not writable."
    assert raised.value.hint.startswith("Make room if that disk is full, or ") and not list(tmp_path.iterdir())


@pytest.mark.parametrize(("given", "written"), [("wind", "wind.npz"), ("wind.npz", "wind.npz"), ("shot.v002", "shot.v002.npz"), ("", None)])
def test_an_npz_file_is_told_by_the_name_it_gets(recovered_file, tmp_path, monkeypatch, capfd, given, written) -> None:
    calls = []
    monkeypatch.setattr(operators, "command", lambda *words: calls.append(words) or command(*words))
    target = tmp_path / written if written else recovered_file.with_name("out_wind.npz")
    capfd.readouterr()
    assert bpy.ops.seeing_wind.export_field(format="NPZ", filepath=str(tmp_path / given) if given else "") == {"FINISHED"}
    (asked,) = calls
    assert asked[asked.index("--out") + 1] == str(target) and f"Exported NPZ to {target}" in capfd.readouterr().out


def test_vdb_files_go_beside_the_blend_file_where_the_take_is_gone(recovered_file, tmp_path, monkeypatch) -> None:
    """A project that was copied without its take must not write into the place that it comes from."""
    settings, written = bpy.context.scene.seeing_wind, []
    monkeypatch.setattr("seeing_wind.ui.field.vdb.write_vdb", lambda scene, field, folder: written.append(folder) or [])
    assert bpy.ops.seeing_wind.export_field(format="VDB") == {"FINISHED"}
    settings.recovered_take = str(recovered_file.parent / "elsewhere" / "gone.take")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "copy.blend"))
    assert bpy.ops.seeing_wind.export_field(format="VDB") == {"FINISHED"}
    assert written == [recovered_file.with_name("out_wind"), tmp_path / "gone_wind"]


def test_the_field_goes_into_vdb_files_where_blender_can(scene, tmp_path) -> None:
    if not openvdb_available():
        with pytest.raises(RuntimeError, match="no OpenVDB.*Export FGA, PLY or NPZ"):
            bpy.ops.seeing_wind.export_field(format="VDB", filepath=str(tmp_path / "vdb"))
        assert bpy.ops.seeing_wind.export_field(filepath=str(tmp_path / "as it can")) == {"FINISHED"}, "what it can write"
        return
    assert bpy.ops.seeing_wind.export_field(filepath=str(tmp_path / "vdb")) == {"FINISHED"}
    assert len(list((tmp_path / "vdb").glob("*.vdb"))) == 12


def test_other_formats_are_the_engines(scene, tmp_path, capfd) -> None:
    assert bpy.ops.seeing_wind.export_field(format="PLY", filepath=str(tmp_path / "ply")) == {"FINISHED"}


def test_exports_fade_as_the_field_does(scene, tmp_path, monkeypatch) -> None:
    """As far as solvers feel it, in metres, whatever the scene's unit."""
    calls = []
    monkeypatch.setattr(operators, "command", lambda *words: calls.append(words) or command(*words))
    field = scene.seeing_wind.field_object
    metres = 0.75 * max(max(vertex.co[axis] for vertex in field.data.vertices) - min(vertex.co[axis] for vertex in field.data.vertices)
                        for axis in range(3))  # fmt: skip
    for kind in ("FADE", "HOLD", "CONTINUE"):
        field["seeing_wind_reach"] = kind
        assert bpy.ops.seeing_wind.export_field(format="PLY", filepath=str(tmp_path / kind)) == {"FINISHED"}
    faded, *others = calls
    assert faded[-2] == "--fade" and float(faded[-1]) == pytest.approx(metres * scene.unit_settings.scale_length)
    assert not any("--fade" in call for call in others)

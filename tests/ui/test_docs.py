"""The scripts that the guide prints run as they stand."""

from __future__ import annotations

import ast
import importlib.util
import re
import shutil
from pathlib import Path

import bpy
import pytest

ROOT = Path(__file__).resolve().parents[2]
HAS_VDB = importlib.util.find_spec("openvdb") is not None or importlib.util.find_spec("pyopenvdb") is not None


def python_blocks(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def place(stand_in, workplace, tmp_path, monkeypatch) -> Path:
    """Where the user stands: a folder with leaf.mp4."""
    shutil.copy(workplace / "clip.mp4", tmp_path / "leaf.mp4")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PWD", str(tmp_path))  # where Blender looks for its own relative paths
    return tmp_path


def test_the_script_on_editing_runs_as_printed(place) -> None:
    (script,) = python_blocks(ROOT / "docs" / "guide" / "edit-and-bake.md")
    bpy.ops.seeing_wind.recover(clip="leaf.mp4", box=(20, 20, 44, 44), distance=2.0, take="leaf.take")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    exec(compile(script, "edit-and-bake.md", "exec"), {})
    assert (place / "baked.blend").is_file() and bpy.data.objects["Flag"].data.shape_keys


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_the_page_on_batch_s_script_runs_as_printed(place) -> None:
    (script,) = python_blocks(ROOT / "docs" / "guide" / "batch-and-farm.md")
    bpy.ops.wm.save_as_mainfile(filepath=str(place / "mine.blend"))
    bpy.context.scene.render.resolution_percentage, bpy.context.scene.frame_end = 10, 2  # the scene keeps its own range
    for name in ("Ribbon", "Curtain"):
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=0.2)
        bpy.context.object.name = name
    bpy.data.objects["Curtain"].modifiers.new("Cloth", "CLOTH")
    for statement in ast.parse(script).body:
        line = ast.unparse(statement)
        if "VDB" in line and not HAS_VDB:
            with pytest.raises(RuntimeError, match="OpenVDB"):
                exec(line, {"bpy": bpy})
            continue
        exec(line.replace("set_up_composite()", "set_up_composite(samples=1)"), {"bpy": bpy})
    assert (place / "edited.mp4").stat().st_size > 0

"""The archive in Blender as a Python module: built, validated, installed, enabled, an operator run, in a process of its own."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import bpy
import extension

ROOT = Path(__file__).resolve().parents[2]

INSTALL = """
import runpy, sys, bpy
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
runpy.run_path(sys.argv[2], run_name="__main__")
print("driven to the end")
"""


def tool(*words: str) -> None:
    """Blender's own tool for extensions."""
    script = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    subprocess.run([sys.executable, str(script), *words], check=True, capture_output=True, timeout=60)


def test_the_archive_installs_runs_and_leaves_nothing(tmp_path) -> None:
    archive = tmp_path / "seeing_wind.zip"
    tool("build", "--source-dir", str(ROOT), "--output-filepath", str(archive))
    tool("validate", str(archive))
    checker = importlib.util.spec_from_file_location("check_zip", ROOT / "tests" / "blender" / "check_zip.py")
    module = importlib.util.module_from_spec(checker)
    checker.loader.exec_module(module)
    module.check(str(archive))
    (tmp_path / "user").mkdir()
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")} | {
        "BLENDER_USER_RESOURCES": str(tmp_path / "user"),
        "SEEING_WIND_CLIP": str(extension.make_clip(tmp_path / "clip.mp4")),
        "SEEING_WIND_PYTHON": str(extension.fake_python(tmp_path)),
        "SEEING_WIND_FAKE_SECONDS": "0.1",
        "TMPDIR": str(tmp_path),
    }
    for script in ("drive_extension.py", "remove_extension.py"):
        call = [sys.executable, "-c", INSTALL, str(archive), str(ROOT / "tests" / "blender" / script)]
        done = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=180)
        assert "driven to the end" in done.stdout, script + done.stdout[-3000:] + done.stderr[-3000:]
        assert done.returncode == 0, script

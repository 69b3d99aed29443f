"""Builds and checks the extension's archive: build_extension.py FOLDER -> FOLDER/seeing_wind-VERSION.zip, whose path is the last line.

The Blender that builds it: BLENDER=, else the one on the PATH, else the tool for extensions that the `bpy` wheel of this Python brings.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main(argv: list[str]) -> int:
    """Build, validate, look inside; returns the exit code."""
    if len(argv) != 1 or argv[0].startswith("-"):
        print(__doc__, file=sys.stderr)
        return 2
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    archive = Path(argv[0]).resolve() / f"{manifest['id']}-{manifest['version']}.zip"
    archive.parent.mkdir(parents=True, exist_ok=True)
    archive.unlink(missing_ok=True)
    tool = extension_tool()
    if tool is None:
        return 1
    for call in (
        [*tool, "build", "--source-dir", str(ROOT), "--output-filepath", str(archive)],
        [*tool, "validate", str(archive)],
        [sys.executable, str(ROOT / "tests" / "blender" / "check_zip.py"), str(archive)],
    ):
        done = subprocess.run(call, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
        if done.returncode or not archive.is_file():
            print(f"{done.stdout}\n{' '.join(call)}\nfailed with exit code {done.returncode}", file=sys.stderr)
            return 1
    print(done.stdout.strip())
    print(archive)
    return 0


def extension_tool() -> list[str] | None:
    """The command that `build` and `validate` are given to; None, and a message, where there is no Blender of any kind."""
    named = os.environ.get("BLENDER")
    blender = shutil.which(named or "blender")
    if named and not blender:
        print(f"BLENDER={named} is no program. Give the path of Blender's executable.", file=sys.stderr)
        return None
    if blender:
        return [blender, "--command", "extension"]
    wheel = importlib.util.find_spec("bpy")  # finds it without loading it
    for folder in (wheel.submodule_search_locations or []) if wheel else []:
        for script in sorted(Path(folder).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")):
            return [sys.executable, str(script)]
    print("There is no Blender here. Install Blender 4.5 or newer, set BLENDER=/path/to/blender, or run `make setup`.", file=sys.stderr)
    return None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Runs a script inside Blender: the one that is named, `BLENDER`, the one on the PATH, or else the `bpy` wheel of this Python."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path


class BlenderFailed(RuntimeError):
    """No Blender, or a script that failed in it; the message ends with what Blender said last."""


def command(script: Path, arguments: list[str], blender: str | None = None) -> list[str]:
    """The command line that runs `script` with `arguments`.

    Raises:
        BlenderFailed: where there is neither a Blender nor the wheel.
    """
    executable = blender or os.environ.get("BLENDER") or shutil.which("blender")
    if executable:
        found = shutil.which(executable)
        if not found:
            raise BlenderFailed(f"{executable} is no program. Give the path of Blender's executable with --blender or BLENDER=.")
        return [found, "-b", "--factory-startup", "--python-exit-code", "9", "--python", str(script.resolve()), "--", *arguments]
    if importlib.util.find_spec("bpy") is None:
        raise BlenderFailed("There is no Blender here. Install Blender 4.5 or newer, set BLENDER=/path/to/blender, or `pip install bpy`.")
    return [sys.executable, str(script.resolve()), *arguments]


def run(script: Path, arguments: list[str], blender: str | None = None, follow: str = "\0") -> str:
    """Run `script` and return what it wrote; lines that start with `follow` are passed on as they come.

    Raises:
        BlenderFailed: also when the script ends with an error.
    """
    lines: list[str] = []
    line_of = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
    with subprocess.Popen(command(script, arguments, blender), **line_of) as process:
        assert process.stdout is not None
        for line in process.stdout:
            lines.append(line)
            if line.startswith(follow):
                print(f"  {line.strip()}", flush=True)
    if process.returncode:
        raise BlenderFailed(f"{script.name} failed in Blender (exit code {process.returncode}):\n" + "".join(lines[-25:]))
    return "".join(lines)

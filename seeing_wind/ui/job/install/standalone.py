"""A Python for the engine alone, for systems without a version for which its packages are built."""

from __future__ import annotations

import platform
import sys
import tomllib
from pathlib import Path
from urllib.parse import quote

import bpy

from ....engine import systems
from .choices import EXTENSION

HERE = Path(__file__).resolve().parent

SIZE = "about 35 MB to download, 120 MB on disk"

SYSTEMS = {
    ("Darwin", "arm64"): "aarch64-apple-darwin",
    ("Linux", "aarch64"): "aarch64-unknown-linux-gnu",
    ("Linux", "x86_64"): "x86_64-unknown-linux-gnu",
    ("Windows", "AMD64"): "x86_64-pc-windows-msvc",
}
"""Names of the builds, by system and processor as in `platform`."""


def build() -> tuple[str, str] | None:
    """Address and SHA-256 of the Python build for this system; None if there is none."""
    known = tomllib.loads((HERE / "standalone.toml").read_text(encoding="utf-8"))
    name = SYSTEMS.get((platform.system(), platform.machine()), "")
    if name not in known["sha256"]:
        return None
    file = f"cpython-{known['version']}+{known['release']}-{name}-install_only_stripped.tar.gz"
    return f"{known['address']}/{known['release']}/{quote(file)}", known["sha256"][name]


def place(create: bool) -> Path | None:
    """The folder of the standalone Python, existing or not; None if this is not an installed extension."""
    if not EXTENSION.startswith("bl_ext."):
        return None
    try:
        return Path(bpy.utils.extension_path_user(EXTENSION, path="python", create=create)) / "standalone"
    except ValueError:  # not enabled through a repository
        return None


def executable(folder: Path) -> Path:
    """The executable of the standalone Python in `folder`."""
    return folder / "python.exe" if systems.windows() else folder / "bin" / "python3"


def command(folder: Path) -> list[str]:
    """The command line that fetches the Python into `folder`; it is run by Blender's own Python, whatever its version.

    Raises:
        KeyError: when there is no build for this system.
    """
    found = build()
    if found is None:
        raise KeyError(f"{platform.system()} {platform.machine()}")
    return [sys.executable, "-I", str(HERE / "fetch_python.py"), *found, str(folder)]

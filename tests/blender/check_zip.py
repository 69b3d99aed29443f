"""What is in the extension's archive: all of the package, its winds, licence and manifest, and nothing else. usage: check_zip.py ZIP"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
AT_ROOT = {"__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "CHANGELOG.md"}


def check(archive: str) -> None:
    """Raises AssertionError for a missing or a superfluous file."""
    names = {name for name in zipfile.ZipFile(archive).namelist() if not name.endswith("/")}
    package = {p.relative_to(ROOT).as_posix() for p in (ROOT / "seeing_wind").rglob("*") if p.suffix in (".py", ".toml", ".txt", ".lock")}
    package |= {p.relative_to(ROOT).as_posix() for p in (ROOT / "seeing_wind" / "ui" / "field" / "library" / "winds").iterdir()}
    missing = (package | {"__init__.py", "blender_manifest.toml"}) - names
    surplus = {name for name in names if name not in AT_ROOT and not name.startswith("seeing_wind/")}
    if missing or surplus:
        raise AssertionError(f"{archive}: missing {sorted(missing)}, surplus {sorted(surplus)}")
    print(f"{len(names)} files, {Path(archive).stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    check(sys.argv[1])

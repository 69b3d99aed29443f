"""Pins another standalone Python that Install Engine may fetch: lock_python.py RELEASE VERSION, such as lock_python.py 20260814 3.13.15

Reads the release's own list of hashes and writes seeing_wind/ui/job/install/standalone.toml anew.
"""

from __future__ import annotations

import sys
import tomllib
import urllib.request
from pathlib import Path

TABLE = Path(__file__).resolve().parents[1] / "seeing_wind" / "ui" / "job" / "install" / "standalone.toml"


def main(argv: list[str]) -> int:
    """Write the table; returns the exit code."""
    if len(argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    release, version = argv
    text = TABLE.read_text(encoding="utf-8")
    known = tomllib.loads(text)
    with urllib.request.urlopen(f"{known['address']}/{release}/SHA256SUMS", timeout=60.0) as answer:
        hashes = dict(reversed(line.split(maxsplit=1)) for line in answer.read().decode().splitlines() if line.strip())
    lines = [line for line in text.splitlines() if line.startswith("#")]
    lines += [f'version = "{version}"', f'release = "{release}"', f'address = "{known["address"]}"', "", "[sha256]"]
    for name in known["sha256"]:
        file = f"cpython-{version}+{release}-{name}-install_only_stripped.tar.gz"
        if file not in hashes:
            print(f"The release {release} has no {file}.", file=sys.stderr)
            return 1
        lines.append(f'{name} = "{hashes[file]}"')
    TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""A film of the jobs on the sample scenes: clip, recovered forces and the edit over the clip side by side. `make film` runs it.

    python sample_scenes/film.py --demo DIR --scenes DIR --out FILE.mp4 [--blender PATH]

--demo is what `make demo` left, --scenes what `make scenes VIDEO=1` left (`whole_jobs.py --video`). A scene that is not there is left out.
common/film_scene.py puts it together in Blender, which has the encoder.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "common"))

from in_blender import BlenderFailed, run  # noqa: E402


def main(argv: list[str] | None = None) -> int:
    """Make the film; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--demo", required=True, type=Path, metavar="DIR")
    parser.add_argument("--scenes", required=True, type=Path, metavar="DIR")
    parser.add_argument("--out", required=True, type=Path, metavar="FILE.mp4")
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    options = parser.parse_args(argv)
    demo, scenes = options.demo.resolve(), options.scenes.resolve()
    parts = [("A falling leaf", demo / "clip" / "clip.mp4", demo / "wind.take" / "overlay.mp4", demo / "edited.mp4")]
    for name, title in (("flag", "A flag"), ("potted_plant", "A potted plant")):
        folder = scenes / name
        parts.append((title, folder / "clip.mp4", folder / "wind.take" / "overlay.mp4", folder / "job.mp4"))
    there = [[title, *map(str, films)] for title, *films in parts if all(film.is_file() for film in films)]
    if not there:
        print("There is nothing to show: run `make demo`, or `make scenes VIDEO=1`, first.", file=sys.stderr)
        return 1
    options.out.parent.mkdir(parents=True, exist_ok=True)
    try:
        run(HERE / "common" / "film_scene.py", [str(options.out.resolve()), json.dumps(there)], options.blender)
    except BlenderFailed as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{', '.join(title for title, *_ in there)}: {options.out.resolve()}, {options.out.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())

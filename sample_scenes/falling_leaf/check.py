"""Holds what a run of demo.py left in a folder against the bars; exit code 1 when one is missed or a file is not what it should be.

    python sample_scenes/falling_leaf/check.py DIR [--blender PATH]

Inside Blender the same script reads demo.blend: that is how it finds out what is in the file.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
# a script of the source tree: it runs with the package installed or not
sys.path[:0] = [str(HERE), str(HERE.parent / "common"), str(HERE.parents[1])]

MOST_DIRECTION, MOST_MAGNITUDE = 10.0, 20.0
"""Errors of the recovered wind that are still good enough [degrees, %]."""
MOST_PINNED = 0.1
"""Movement of pinned vertices [mm]."""
MASS_TOLERANCE = 0.02
"""Relative, on the half of the acceleration that twice the mass should have."""
HELD, FREE = ("Towel", "Napkin", "Sheet", "Pillowcase"), ("Leaf", "Leaf Twice the Mass")
"""What the demo inserts."""
MARK = "check: "

Row = tuple[bool, str, str, str]
"""Passed, what, found, wanted."""


def main(argv: list[str] | None = None) -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="DIR", type=Path, help="as given to demo.py with --out")
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    options = parser.parse_args(argv)
    rows = check_figures(options.folder) + check_files(options.folder, options.blender)
    width = [max(len(row[column]) for row in rows) for column in (1, 2)]
    for passed, what, found, wanted in rows:
        print(f"  {'ok    ' if passed else 'FAILED'}  {what:<{width[0]}}  {found:>{width[1]}}  {wanted}".rstrip())
    missed = sum(not row[0] for row in rows)
    print(f"{missed} of {len(rows)} checks failed: {options.folder}" if missed else f"all {len(rows)} checks passed: {options.folder}")
    return 1 if missed else 0


def check_figures(folder: Path) -> list[Row]:
    """What demo.json says. NaN passes no bar."""
    try:
        figures = json.loads((folder / "demo.json").read_text(encoding="utf-8"))
        direction, magnitude = float(figures["direction_degrees"]), float(figures["magnitude_percent"])
        pinned, ratio = float(figures["pinned_moved_mm"]), float(figures["doubled_mass_acceleration"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        return [(False, "demo.json", f"{type(error).__name__}: {error}", "run `make demo` first")]
    return [
        (direction < MOST_DIRECTION, "direction error of the recovered wind", f"{direction:.2f} degrees", f"under {MOST_DIRECTION:g}"),
        (magnitude < MOST_MAGNITUDE, "magnitude error of the recovered wind", f"{magnitude:.2f} %", f"under {MOST_MAGNITUDE:g}"),
        (pinned < MOST_PINNED, "pinned vertices moved at most", f"{pinned:.4f} mm", f"under {MOST_PINNED:g}"),
        (
            abs(ratio / 0.5 - 1.0) <= MASS_TOLERANCE,
            "acceleration of twice the mass, of the single",
            f"{ratio:.4f}",
            f"0.5 within {100 * MASS_TOLERANCE:g} %",
        ),
    ]


def check_files(folder: Path, blender: str | None) -> list[Row]:
    """The clip and all results, each opened."""
    rows: list[Row] = []
    clip = attempt(rows, "clip.mp4", folder / "clip" / "clip.mp4", pictures_in, lambda count: count > 1, "frames")
    for path in (folder / "wind.take" / "overlay.mp4", folder / "edited.mp4"):
        attempt(rows, path.name, path, pictures_in, lambda count: count == clip, f"frames, as many as the clip ({clip})")
    attempt(rows, "report.png", folder / "wind.take" / "report.png", pixels_in, lambda count: count > 0, "pixels")
    in_file: dict = {}

    def keys_in(path: Path) -> int:
        in_file.update(inside(path, blender))
        return in_file["keys"]

    wanted = f"shape keys of each body, one per frame ({clip})"
    attempt(rows, "demo.blend", folder / "demo.blend", keys_in, lambda count: count == clip, wanted)
    if in_file:
        pinned = in_file["pinned_moved_mm"]
        rows.append((pinned < MOST_PINNED, "pinned vertices in demo.blend moved at most", f"{pinned:.4f} mm", f"under {MOST_PINNED:g}"))
    return rows


def attempt(rows: list[Row], name: str, path: Path, read: Callable[[Path], int], good: Callable[[int], bool], unit: str) -> int | None:
    """Add a row for the file `path`; returns what `read` counted, None for a file that is not there or cannot be read."""
    from in_blender import BlenderFailed

    if not path.is_file() or not path.stat().st_size:
        rows.append((False, name, "empty" if path.is_file() else "missing", unit))
        return None
    try:
        count = read(path)
    except (BlenderFailed, ValueError) as error:
        rows.append((False, name, "unreadable", str(error).strip().splitlines()[-1]))
        return None
    rows.append((good(count), name, str(count), unit))
    return count


def pictures_in(path: Path) -> int:
    """How many frames of a video can be decoded.

    Raises:
        ValueError: for a file that is no video, or whose frames are all of one colour.
    """
    import cv2

    video, count, contrast = cv2.VideoCapture(str(path)), 0, 0.0
    while True:
        there, frame = video.read()
        if not there:
            break
        count, contrast = count + 1, max(contrast, float(frame.std()))
    video.release()
    if not count or contrast < 1.0:
        raise ValueError("nothing is to be seen in it" if count else "not a video")
    return count


def pixels_in(path: Path) -> int:
    """How many pixels an image has. Raises ValueError for a file that is no image, or an empty one."""
    import cv2

    image = cv2.imread(str(path))
    if image is None or image.std() < 1.0:
        raise ValueError("not an image" if image is None else "nothing is to be seen in it")
    return image.shape[0] * image.shape[1]


def inside(path: Path, blender: str | None) -> dict:
    """What `report_blend` finds in a .blend. Raises BlenderFailed or ValueError."""
    from in_blender import run

    said = run(Path(__file__), ["--inside", str(path.resolve())], blender)
    found = [line[len(MARK) :] for line in said.splitlines() if line.startswith(MARK)]
    if len(found) != 1:
        raise ValueError("Blender did not open it: " + " | ".join(said.splitlines()[-3:]))
    return json.loads(found[0])


def report_blend(path: str) -> None:
    """In Blender: the fewest shape keys of any body, and how far the keys move the vertices of the groups that are held."""
    import bpy
    import numpy as np

    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
    if bpy.data.objects["Recovered Wind"].field.type != "TEXTURE":
        raise ValueError("the field object is no wind")
    moved = 0.0
    for obj in (bpy.data.objects[name] for name in HELD):
        held = obj.vertex_groups["Held"].index
        vertices = [vertex.index for vertex in obj.data.vertices if any(group.group == held for group in vertex.groups)]
        keys = []
        for block in obj.data.shape_keys.key_blocks:
            places = np.empty(3 * len(block.data), dtype=np.float32)
            block.data.foreach_get("co", places)
            keys.append(places.reshape(-1, 3)[vertices])
        moved = max(moved, 1000.0 * float(np.linalg.norm(np.array(keys) - keys[0], axis=-1).max()))
    fewest = min(len(bpy.data.objects[name].data.shape_keys.key_blocks) for name in (*HELD, *FREE))
    print(MARK + json.dumps({"keys": fewest, "pinned_moved_mm": moved}), flush=True)


if __name__ == "__main__":
    if "--inside" in sys.argv:
        report_blend(sys.argv[sys.argv.index("--inside") + 1])
    else:
        sys.exit(main())

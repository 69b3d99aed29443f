"""Opens the file that whole_job.py saved in a Blender that knows nothing of the extension, and looks whether its motion still plays.

    blender -b --factory-startup --python-exit-code 9 --python replay.py -- DIR        or        python replay.py DIR

Compares every frame with shown.npz, which was taken before saving, and the ribbon with what the engine simulated. Ends with exit code 9
where they differ; prints one JSON line with the figures.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

MOST = 1e-5
"""Metres that single precision may make of a difference."""
LEAST = 1e-3
"""Metres that something must move to count as moving."""


def shown(names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Where the vertices of the named objects are [m, world], in every frame of the scene, as Blender evaluates them: (T+1, V, 3) each."""
    scene, motion = bpy.context.scene, {name: [] for name in names}
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for name, places in motion.items():
            evaluated = scene.objects[name].evaluated_get(depsgraph)
            flat = np.empty(3 * len(evaluated.data.vertices), dtype=np.float32)
            evaluated.data.vertices.foreach_get("co", flat)
            matrix = np.array(evaluated.matrix_world)
            places.append(flat.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
    return {name: np.array(places) for name, places in motion.items()}


def main(folder: Path) -> None:
    """Open, play, compare."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(folder / "job.blend"), load_ui=False)
    if hasattr(bpy.types.Scene, "seeing_wind") or any("seeing_wind" in name for name in bpy.context.preferences.addons.keys()):
        raise SystemExit("replay: the extension is switched on here")
    with np.load(folder / "shown.npz", allow_pickle=False) as data:
        before = {name: data[name] for name in data.files}
    with np.load(folder / "wind.edit.take" / "bodies" / "Ribbon.npz", allow_pickle=False) as data:
        simulated = data["vertices"]
    now = shown(tuple(before))
    figures = {"Ribbon, against the simulation": float(np.abs(now["Ribbon"] - simulated).max())}
    for name, vertices in now.items():
        figures[name] = float(np.abs(vertices - before[name]).max())
    moved = {name: float(np.linalg.norm(vertices - vertices[0], axis=-1).max()) for name, vertices in now.items()}
    good = max(figures.values()) <= MOST and min(moved.values()) >= LEAST
    field = next((obj for obj in bpy.context.scene.objects if obj.field is not None and obj.field.type == "TEXTURE"), None)
    print("replay: " + json.dumps({"differs_m": figures, "moved_m": moved, "blender": bpy.app.version_string}), flush=True)
    if not good or field is None:
        raise SystemExit(9)


if __name__ == "__main__":
    main(Path((sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])[0]).resolve())

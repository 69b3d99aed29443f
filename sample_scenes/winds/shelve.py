"""The Blender part of the library: winds.blend with an asset for each wind, its catalogs, and winds.json. See make.py.

    blender -b --factory-startup --python shelve.py -- OUT TAKES NAME ...         or         python shelve.py OUT TAKES NAME ...
"""

from __future__ import annotations

import json
import sys
import uuid
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]  # the source tree

from pictured import SIZE, pictured  # noqa: E402
from winds import FPS, OVERLAP, WINDS, Shelved  # noqa: E402

import seeing_wind.ui as ui  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402
from seeing_wind.ui.field.display import WIND, said_of_wind  # noqa: E402
from seeing_wind.ui.field.field_object import create_field_object  # noqa: E402
from seeing_wind.ui.field.lattice import SampledField  # noqa: E402
from seeing_wind.ui.field.library.shelf import BLEND, CATALOGS, INDEX  # noqa: E402
from seeing_wind.ui.field.texture.reach import FADE, HOLD  # noqa: E402
from seeing_wind.ui.job.take_reading import wind_told  # noqa: E402

SPACE = uuid.UUID("6f1c3a52-3f0e-4a75-9c55-0d7a3b0f5e11")
"""Catalogs' ids are made of it and their names: the same at every run, so that files that use them keep them."""
ROOT_CATALOG = "Recovered Winds"


def main(out: Path, takes: Path, names: list[str]) -> None:
    """Make the files."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "seeing_wind"):
        ui.register()
    out.mkdir(parents=True, exist_ok=True)
    shelf = [each for each in WINDS if each.name in names]
    index = [shelved(each, takes / each.name.replace(" ", "_").lower()) for each in shelf]
    paths = [f"{ROOT_CATALOG}/{name}" for name in dict.fromkeys(each.catalog for each in shelf)]
    lines = ["VERSION 1", "", *(f"{catalog(path)}:{path}:{path.replace('/', '-')}" for path in (ROOT_CATALOG, *paths))]
    (out / CATALOGS).write_text("\n".join(lines) + "\n", encoding="utf-8")
    (out / INDEX).write_text(json.dumps(index, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(out / BLEND), compress=True)
    print(f"{len(index)} winds, {sum(path.stat().st_size for path in out.iterdir()) / 1e6:.2f} MB in {out}", flush=True)


def catalog(path: str) -> str:
    """The id of a catalog."""
    return str(uuid.uuid5(SPACE, path))


def off_in_the_box(each: Shelved, rows: dict[str, np.ndarray]) -> float:
    """Mean angle to the known wind over all nodes [degrees]: away from its path a plate tells little of what differs there."""
    found = rows["wind_velocity"]
    begin = OVERLAP if len(found) > OVERLAP else 0  # those before are mixed with later ones
    known = np.stack([each.wind(rows["nodes"], (t + 0.5) / FPS) for t in range(begin, len(found))])
    sizes = np.linalg.norm(known, axis=-1) * np.linalg.norm(found[begin:], axis=-1)
    cosine = (known * found[begin:]).sum(axis=-1) / np.maximum(sizes, 1e-12)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())


def rounded(values: np.ndarray) -> np.ndarray:
    """To a thousandth of the largest value, so that the file stays small."""
    step = max(float(np.abs(values).max()), 1e-9) / 1024.0
    return np.round(values / step) * step


def shelved(each: Shelved, folder: Path) -> dict:
    """The asset of a wind that make.py recovered into `folder`; returns its line of the index."""
    with np.load(folder / "on_the_shelf.npz", allow_pickle=False) as kept:
        rows = {name: kept[name] for name in kept.files}
    told = wind_told(Take(folder / "wind.take"))
    force, velocity, sure = (rounded(rows[name]) for name in ("force_density", "wind_velocity", "wind_confidence"))
    sampled = SampledField(rows["nodes"], force, sure, velocity)
    obj = create_field_object(
        bpy.context.scene, each.name, sampled, fps=FPS, density=float(rows["density"]), reach=HOLD if each.everywhere else FADE, kind=WIND,
        speeds=(told.mean, told.gust), drag=told.drag, loops=each.loops,
    )  # fmt: skip
    obj.location = (0.0, 0.0, 0.0)
    obj.asset_mark()
    about = obj.asset_data
    size, angle = (float(value) for value in rows["off"])
    about.description = (
        f"{each.description}. {said_of_wind(obj)}. {'Goes round' if each.loops else 'Blows once'} in "
        f"{len(sampled.force) / FPS:.2g} s; recovered from a plate that it carries, {size:.0f} % and {angle:.0f}° off the known wind "
        f"there, {off_in_the_box(each, rows):.0f}° in the mean over its box"
    )
    about.author, about.catalog_id = "Seeing Wind", catalog(f"{ROOT_CATALOG}/{each.catalog}")
    for tag in ("wind", *each.tags):
        about.tags.new(tag, skip_if_exists=True)
    preview = obj.preview_ensure()
    preview.image_size = (SIZE, SIZE)
    preview.image_pixels_float.foreach_set(pictured(sampled).ravel())
    return {"name": each.name, "catalog": each.catalog, "description": about.description}


if __name__ == "__main__":
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(Path(words[0]), Path(words[1]), words[2:])

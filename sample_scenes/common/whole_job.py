"""The whole job on the clip of a sample scene with nothing but operators: recover, insert, pin, re-simulate, bake, composite, save.

    blender -b --factory-startup --python-exit-code 9 --python whole_job.py -- DIR [--iterations N] [--particles N] [--video] [--no-render]
    or, in any Python that has the `bpy` wheel,    python whole_job.py DIR ...

DIR holds a clip as a scene's make.py writes it. Results go into it: wind.take, wind.edit.take, job.blend, job.png, with --video job.mp4,
and shown.npz: where the file's moving meshes are in every frame, which replay.py compares with what a Blender without the extension shows.
"""

import json
import os
import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]  # the source tree

from replay import shown  # noqa: E402

import seeing_wind.ui as ui  # noqa: E402

RIBBON = (0.05, 0.2)
"""Width and length of the inserted ribbon [m]."""
CELLS = (6, 25)
"""Its vertices across and along."""


def main(words: list[str]) -> None:
    """Do it."""
    folder = Path(words[0]).resolve()
    os.environ.setdefault("SEEING_WIND_PYTHON", str(HERE.parents[1] / ".venv" / "bin" / "python"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "seeing_wind"):
        ui.register()
    known = json.loads((folder / "box.json").read_text())
    options = {name: known[name] for name in ("distance", "material", "density", "youngs_modulus", "thickness")}
    options |= {name: int(words[words.index(f"--{name}") + 1]) for name in ("iterations", "particles") if f"--{name}" in words}
    if (folder / "held_0000.png").is_file():
        options["pin"] = str(folder / "held_0000.png")
    done(bpy.ops.seeing_wind.choose_clip(filepath=str(folder / "clip.mp4")))
    done(bpy.ops.seeing_wind.recover(
        mask=str(folder / "mask_0000.png"), camera=str(folder / "camera.json"), take=str(folder / "wind.take"), **options,
    ))  # fmt: skip
    scene = bpy.context.scene
    insert_beside(scene, known)
    done(bpy.ops.seeing_wind.resimulate())
    scene.seeing_wind.bake_smooth = 0  # replay.py compares with what the engine simulated
    done(bpy.ops.seeing_wind.bake())
    # as thorough as Blender's usual one, the denoiser takes longer than the samples
    scene.cycles.denoising_prefilter = scene.cycles.denoising_quality = "FAST"
    # the camera of the sample clips has no shutter: their frames are sharp
    done(bpy.ops.seeing_wind.set_up_composite(samples=16, shutter=0.0))
    if "--no-render" not in words:
        scene.frame_set((scene.frame_start + scene.frame_end) // 2)
        done(bpy.ops.seeing_wind.render_composite(filepath=str(folder / "job.png"), still=True))
    if "--video" in words:
        done(bpy.ops.seeing_wind.render_composite(filepath=str(folder / "job.mp4")))
    np.savez_compressed(folder / "shown.npz", **shown(("Ribbon", scene.seeing_wind.recovered_object.name)))
    scene.frame_set(scene.frame_start)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "job.blend"), compress=True)
    print(f"job: {folder / 'job.blend'}", flush=True)


def done(outcome: set) -> None:
    """Operators report errors as an outcome; here an error ends the script."""
    if outcome != {"FINISHED"}:
        raise SystemExit("job: an operator did not finish; what it said is above")


def insert_beside(scene, known: dict) -> None:
    """A ribbon to the right of the clip's object, as heavy as it, held at its upper end."""
    vertices = np.array([vertex.co[:] for vertex in scene.seeing_wind.recovered_object.data.vertices])
    low, high = vertices.min(0), vertices.max(0)
    place = (high[0] + 0.06, 0.5 * (low[1] + high[1]), high[2] - 0.5 * RIBBON[1])
    bpy.ops.mesh.primitive_grid_add(
        x_subdivisions=CELLS[0] - 1, y_subdivisions=CELLS[1] - 1, size=1.0, location=place, rotation=(0.5 * np.pi, 0.0, 0.0)
    )
    ribbon = bpy.context.object
    ribbon.name, ribbon.scale = "Ribbon", (*RIBBON, 1.0)
    material = bpy.data.materials.new("Ribbon")
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.6, 0.04, 0.15, 1.0)
    ribbon.data.materials.append(material)
    upper = [vertex.index for vertex in ribbon.data.vertices if vertex.co.y > 0.499]
    ribbon.vertex_groups.new(name="Held").add(upper, 1.0, "REPLACE")
    done(bpy.ops.seeing_wind.insert_mesh(object="Ribbon", material=known["material"], density=known["density"], youngs_modulus=1.0e5))
    done(bpy.ops.seeing_wind.pin_vertices(object="Ribbon", vertex_group="Held"))


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])

"""The whole job on the clip of a sample scene with nothing but the panel's operators: recover, insert, pin, re-simulate, bake, composite.

    blender -b --factory-startup --python-exit-code 9 --python whole_job.py -- DIR [--iterations N] [--video]
    or, in any Python that has the `bpy` wheel,    python whole_job.py DIR [--iterations N] [--video]

DIR holds a clip as a scene's make.py writes it. Results go into it: wind.take, wind.edit.take, job.blend, job.png, with --video job.mp4.
"""

import json
import os
import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))  # the source tree

import seeing_wind.ui as ui  # noqa: E402

RIBBON = (0.05, 0.2)
"""Width and length of the inserted ribbon [m]."""


def main(words: list[str]) -> None:
    """Do it."""
    folder = Path(words[0]).resolve()
    os.environ.setdefault("SEEING_WIND_PYTHON", str(HERE.parents[1] / ".venv" / "bin" / "python"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "seeing_wind"):
        ui.register()
    known = json.loads((folder / "box.json").read_text())
    options = {name: known[name] for name in ("distance", "material", "density", "youngs_modulus", "thickness")}
    if (folder / "held_0000.png").is_file():
        options["pin"] = str(folder / "held_0000.png")
    if "--iterations" in words:
        options["iterations"] = int(words[words.index("--iterations") + 1])
    done(bpy.ops.seeing_wind.recover(
        clip=str(folder / "clip.mp4"), mask=str(folder / "mask_0000.png"), camera=str(folder / "camera.json"),
        take=str(folder / "wind.take"), **options,
    ))  # fmt: skip
    insert_beside(bpy.context.scene, known)
    done(bpy.ops.seeing_wind.resimulate())
    done(bpy.ops.seeing_wind.bake())
    done(bpy.ops.seeing_wind.set_up_composite(samples=8))
    scene = bpy.context.scene
    scene.frame_set((scene.frame_start + scene.frame_end) // 2)
    done(bpy.ops.seeing_wind.render_composite(filepath=str(folder / "job.png"), still=True))
    if "--video" in words:
        done(bpy.ops.seeing_wind.render_composite(filepath=str(folder / "job.mp4")))
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
    across, along = np.meshgrid(np.linspace(-0.5, 0.5, 6), np.linspace(0.5, -0.5, 25))
    rest = np.stack([across * RIBBON[0], np.zeros_like(across), along * RIBBON[1]], -1).reshape(-1, 3)
    rest += [high[0] + 0.06, 0.5 * (low[1] + high[1]), high[2] - 0.5 * RIBBON[1]]
    index = np.arange(len(rest)).reshape(across.shape)
    faces = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    mesh = bpy.data.meshes.new("Ribbon")
    mesh.from_pydata(rest.tolist(), [], faces.tolist())
    material = bpy.data.materials.new("Ribbon")
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.6, 0.04, 0.15, 1.0)
    mesh.materials.append(material)
    ribbon = bpy.data.objects.new("Ribbon", mesh)
    scene.collection.objects.link(ribbon)
    ribbon.vertex_groups.new(name="Held").add(index[0].tolist(), 1.0, "REPLACE")
    done(bpy.ops.seeing_wind.insert_mesh(object="Ribbon", material=known["material"], density=known["density"], youngs_modulus=1.0e5))
    done(bpy.ops.seeing_wind.pin_vertices(object="Ribbon", vertex_group="Held"))


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])

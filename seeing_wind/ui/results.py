"""From a take to the scene: the field object, its arrows, the camera with the clip behind it, and the recovered object with its motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..engine.errors import TakeError
from ..engine.records import Camera, Surface
from ..engine.take import Take, from_arrays
from . import field_legend, field_samples, job, physics_nodes, worker_calls
from .bake import bake_shape_keys
from .clip_scene import create_recovered_object, setup_clip_scene
from .field_arrows import create_arrows
from .field_kernels import lattice
from .field_legend import create_legend
from .field_object import create_field_object
from .units import metres_per_unit

COLLECTION = "Seeing Wind"
POINTS, SAMPLES = "blender_points.npy", "blender_samples.npz"
RIDING = 64
"""Arrows that ride on the recovered object, at most: more of them hide it."""


@dataclass(frozen=True)
class FieldSummary:
    """What the scene needs to know of a recovered field."""

    box: np.ndarray
    """(2, 3) lower and upper corner [m]."""
    fps: float
    frames: int
    """T."""
    density: float
    """Of the recovered material [kg/m³]."""
    clip: str
    """Path of the video; "" for a field from trajectories."""
    first_frame: int
    """Index in the video of picture 0."""


@dataclass(frozen=True)
class Places:
    """Where the field is asked for. The three groups go to the worker as one array, in this order."""

    nodes: np.ndarray
    """(M, 3) of the field object [m]."""
    probes: np.ndarray
    """(P, 3) between the nodes [m]."""
    riding: np.ndarray
    """(T, R, 3) on the moving object [m]; R may be 0."""

    def rows(self) -> np.ndarray:
        """(T, M + P + R, 3), one row per frame, as the worker's `sample` takes them."""
        still = np.concatenate([self.nodes, self.probes])
        return np.concatenate([np.broadcast_to(still, (len(self.riding), *still.shape)), self.riding], axis=1)

    def split(self, samples: np.ndarray) -> list[np.ndarray]:
        """Samples (T, M + P + R, ...) -> one array per group."""
        return np.split(samples, [len(self.nodes), len(self.nodes) + len(self.probes)], axis=1)


def places(take: Take, resolution: int) -> Places:
    """Where to sample the field of a take.

    Raises:
        TakeError: when the take has no report.
    """
    field = field_summary(take)
    box = field.box
    nodes = lattice(box, resolution)
    inset = 0.5 * (box[1] - box[0]) / max(resolution - 1, 1)
    x = take.read_arrays("trajectory.npz")["x"][: field.frames]
    return Places(nodes, lattice(np.stack([box[0] + inset, box[1] - inset]), resolution), x[:, :: max(1, -(-x.shape[1] // RIDING))])


def sampling(python: str, folder: Path, resolution: int) -> job.Messages:
    """Ask the engine for the field of a take at the places that the scene needs, as a job; `build` reads its answer."""
    take = Take(folder)
    points = take.file(POINTS)
    with take.writing(points.name) as aside:
        np.save(aside, places(take, resolution).rows())
    options = (str(folder), "--points", str(points), "--out", str(take.file(SAMPLES)))
    return (yield from job.run(worker_calls.command(python, "sample", *options), cwd=str(folder), env=worker_calls.environment()))


def build(scene: bpy.types.Scene, folder: Path, clip: str = "") -> None:
    """Put the results of a take into `scene`, in place of those of a former one. Keeps what was made in the scene's settings.

    Args:
        scene: changed; see `clip_scene.setup_clip_scene` for what of it.
        folder: of the take, sampled before (`sampling`).
        clip: path of the video; by default the one that the take names.

    Raises:
        TakeError: when the take lacks something; the scene is then as before.
    """
    settings, take = scene.seeing_wind, Take(folder)
    field, where, samples = field_summary(take), places(take, settings.field_resolution), take.read_arrays(SAMPLES)
    if samples["force_density"].shape != (field.frames, where.rows().shape[1], 3):
        raise TakeError(f"The samples in {folder} do not fit its field.", "Load the results again.")
    at_nodes, at_probes, at_riding = where.split(samples["force_density"])
    sure_nodes, _, sure_riding = where.split(samples["confidence"])
    body = take.read_arrays("particles.npz") if take.file("particles.npz").is_file() else {}
    seen = take.read_arrays("observation.npz") if take.file("observation.npz").is_file() else {}

    followers = physics_nodes.companions(settings.field_object)
    remove(settings)
    collection = _collection(scene)
    if seen:
        camera = vars(from_arrays(Camera, seen, "camera."))
        settings.camera_object = setup_clip_scene(
            scene, clip or field.clip, camera, field.fps, field.first_frame, field.frames, settings.frame_start
        )
    settings.field_object = create_field_object(
        scene, "Recovered Wind", where.nodes, at_nodes, fps=field.fps, density=field.density, frame_start=settings.frame_start,
        probes=where.probes, probe_vectors=at_probes, confidence=sure_nodes, take=folder, collection=collection,
    )  # fmt: skip
    physics_nodes.follow(followers, settings.field_object)
    nodes = np.broadcast_to(where.nodes, at_nodes.shape)
    settings.arrows_object = create_arrows(
        scene, "Recovered Wind Arrows", np.concatenate([nodes, where.riding], axis=1), np.concatenate([at_nodes, at_riding], axis=1),
        np.concatenate([sure_nodes, sure_riding], axis=1), settings.frame_start, parent=settings.field_object, collection=collection,
    )  # fmt: skip
    low, high = field.box / metres_per_unit(scene)
    aside = low - [0.06 * (high - low).max(), 0.0, 0.0]
    create_legend(
        "Recovered Wind Legend", settings.arrows_object["seeing_wind_peak"], aside, 0.6 * float((high - low).max()), collection,
        settings.field_object,
    )  # fmt: skip
    if body and seen:
        settings.recovered_object = _recovered(scene, take, body, seen["image"], field.fps, collection)


def remove(settings: bpy.types.PropertyGroup) -> None:
    """Take former results out of the file; what the user has deleted already is no error. Edits and the camera stay."""
    for name in ("field_object", "arrows_object", "recovered_object"):
        obj = getattr(settings, name)
        if obj is not None:
            for child in obj.children:
                if any(mark in child for mark in (field_samples.MARK, field_legend.MARK)):
                    hidden = child.data
                    bpy.data.objects.remove(child)
                    bpy.data.meshes.remove(hidden)
                else:
                    child.parent = None
            data = obj.data
            bpy.data.objects.remove(obj)
            if isinstance(data, bpy.types.Mesh) and data.users == 0:
                bpy.data.meshes.remove(data)


def field_summary(take: Take) -> FieldSummary:
    """Read it from the report.

    Raises:
        TakeError: when the report is missing, or from another version.
    """
    report = take.read_json("report.json")
    try:
        box, clip = np.asarray(report["box"], dtype=np.float64), report.get("clip", {})
        return FieldSummary(
            box,
            float(report["fps"]),
            int(report["frames"]),
            float(report["material"]["density"]),
            clip.get("path", ""),
            int(clip.get("first_frame", 0)),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise TakeError(f"The report of {take.path} does not describe its field ({error}).", "Run Recover again.") from error


def _recovered(
    scene: bpy.types.Scene, take: Take, body: dict[str, np.ndarray], picture: np.ndarray, fps: float, collection: bpy.types.Collection
) -> bpy.types.Object:
    surface = from_arrays(Surface, body, "surface.")
    obj = create_recovered_object(scene, "Recovered Object", surface.vertices, surface.triangles, surface.uv, picture, collection)
    bake_shape_keys(obj, surface.attachment.follow(take.read_arrays("trajectory.npz")["x"]), scene.seeing_wind.frame_start, fps, scene)
    return obj


def _collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    collection = next((each for each in scene.collection.children_recursive if each.get("seeing_wind")), None)
    if collection is None:
        collection = bpy.data.collections.new(COLLECTION)
        collection["seeing_wind"] = True
        scene.collection.children.link(collection)
    return collection


# -- re-simulated bodies ----------------------------------------------------------------------------------------------------------


def import_bodies(scene: bpy.types.Scene, folder: Path, frame_start: int) -> list[bpy.types.Object]:
    """All bodies of a re-simulation as new objects with their motion, for files that are made without a session before."""
    take, made = Take(folder), []
    for path in sorted(take.file("bodies").glob("*.npz")):
        arrays = take.read_arrays(f"bodies/{path.name}")
        mesh = bpy.data.meshes.new(path.stem)
        mesh.from_pydata(arrays["vertices"][0].tolist(), [], arrays["triangles"].tolist())
        mesh.update()
        obj = bpy.data.objects.new(path.stem, mesh)
        _collection(scene).objects.link(obj)
        bake_shape_keys(obj, arrays["vertices"], frame_start, float(arrays["fps"]), scene)
        made.append(obj)
    return made

"""The object's outline in every frame of the clip, as mattes: what cuts the edit behind it, and where the clean plate covers it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import TakeError, UsageError
from ...engine.masks import Masks
from ...engine.record_arrays import from_arrays
from ...engine.take import Take
from ..bake.animation import curves_of, make_linear, remove_curves, retime
from ..clip.inputs.mask import png
from ..clip.inputs.pace import Pace, pace_of_scene, set_pace_of_images
from ..job import takes
from ..scene_units import metres_per_unit
from ..user_paths import absolute
from .own import drop_unused, is_called, own_object

FOLDER, IMAGE, CARD = "mattes", "Seeing Wind Mattes", "Seeing Wind Holdout"
HELD_OUT, COVERED = "Red", "Green"
"""Channels of a matte: the outline, its edge a pixel soft; and the same wider, for the object's shadow rim and motion blur."""
WIDER = 0.012
"""Of the frame's longer side, by which the cover is wider than the outline."""

MARGIN = 3
"""Pixels round an outline that its soft edge takes up."""


@dataclass(frozen=True)
class Mattes:
    """The images on disk, and what the compositor needs to know of them."""

    image: bpy.types.Image
    frames: int
    pace: Pace
    """At which scene frame each is shown."""
    window: np.ndarray
    """(2, 2): left and lower, right and upper end of all that the outlines reach in the clip, as shares of the frame."""


def mattes_of(scene: bpy.types.Scene, take: Take) -> Mattes | None:
    """Write a take's mattes as PNGs into the take, where they are not yet, and load them. None for a take without outlines.

    Raises:
        TakeError: when the outlines are damaged, or the PNGs cannot be written.
    """
    arrays = take.read_arrays("observation.npz") if take.file("observation.npz").is_file() else {}
    if "masks.windows" not in arrays:
        return None
    masks = from_arrays(Masks, arrays, "masks.")
    folder, newer = take.file(FOLDER), take.file("observation.npz").stat().st_mtime
    paths = [folder / _name(t) for t in range(len(masks))]
    missing = {path for path in paths if not path.is_file() or path.stat().st_mtime < newer}
    if missing:
        check_room(take)
    for path, mask in zip(paths, masks, strict=True):
        if path in missing:
            with take.writing(f"{FOLDER}/{path.name}") as aside:
                aside.write_bytes(png(matte(mask)))
    return Mattes(_loaded(folder / _name(0)), len(masks), pace_of_scene(scene), window_of(masks))


def check_room(take: Take) -> None:
    """See that a take can be written where the images of its composite go. Raises TakeError where it cannot."""
    name = take.path.name
    takes.refuse_read_only(
        take.file(FOLDER), f"Save this file into a folder that can be written, put a copy of {name} beside it and try again."
    )


def window_of(masks: Masks) -> np.ndarray:
    """As `Mattes.window`; with a margin for soft edges, which may reach beyond the frame."""
    seen = masks.windows[masks.windows[:, 2] > masks.windows[:, 0]]
    if not len(seen):
        return np.zeros((2, 2))
    low, high = seen[:, :2].min(axis=0) - MARGIN, seen[:, 2:].max(axis=0) + MARGIN
    share = np.stack([low, high]) / [masks.width, masks.height]
    share[:, 1] = 1.0 - share[::-1, 1]
    return share


def matte(mask: np.ndarray) -> np.ndarray:
    """The matte (H, W, 3) uint8 of a mask (H, W) bool."""
    found, wider = np.zeros((*mask.shape, 3), np.uint8), max(2, round(WIDER * max(mask.shape)))
    if not mask.any():
        return found
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    # only round the object: a large frame would take seconds
    part = tuple(slice(max(at[0] - wider - 3, 0), at[-1] + wider + 4) for at in (rows, columns))
    found[*part, 0], found[*part, 1] = softened(narrowed(mask[part]), 1), softened(widened(mask[part], wider), 2)
    return found


def narrowed(mask: np.ndarray) -> np.ndarray:
    """A mask (H, W) bool without its outermost pixels, in which what is behind shows as a pale rim; what is thinner than three stays."""
    inner = ~widened(~mask, 1)
    return inner | (mask & ~widened(inner, 2))


def widened(mask: np.ndarray, pixels: int) -> np.ndarray:
    """A mask (H, W) bool grown by a square of `pixels` on each side."""
    for axis in (0, 1):
        grown = mask.copy()
        for step in range(1, pixels + 1):
            for ahead, behind in ((slice(step, None), slice(None, -step)), (slice(None, -step), slice(step, None))):
                to, source = (ahead, behind) if axis == 0 else ((slice(None), ahead), (slice(None), behind))
                grown[to] |= mask[source]
        mask = grown
    return mask


def softened(mask: np.ndarray, pixels: int) -> np.ndarray:
    """A mask (H, W) bool with an edge of some pixels: (H, W) uint8."""
    values = mask.astype(np.float32)
    for _ in range(pixels):
        for axis in (0, 1):
            padded = np.pad(values, [(1, 1) if each == axis else (0, 0) for each in (0, 1)], mode="edge")
            values = sum(w * np.take(padded, np.arange(k, k + mask.shape[axis]), axis=axis) for k, w in enumerate((0.25, 0.5, 0.25)))
    return np.round(255.0 * values).astype(np.uint8)


def _loaded(first: Path) -> bpy.types.Image:
    try:
        image = bpy.data.images.load(bpy.path.relpath(str(first)) if bpy.data.filepath else str(first), check_existing=True)
    except RuntimeError as error:
        raise TakeError(f"Blender cannot read the matte {first}.", "Delete the folder and set the composite up again.") from error
    image.reload()
    if not is_called(image, IMAGE):
        image.name = IMAGE
    image.source, image.colorspace_settings.name = "SEQUENCE", "Non-Color"
    return image


def keep_pace(scene: bpy.types.Scene, pace: Pace) -> None:
    """Let the mattes that a scene has, in the compositor and on its card, go by at another pace."""
    card = own_object(scene, CARD)
    frames = int(scene.seeing_wind.field_object["seeing_wind_frames"]) + 1
    if card is not None:
        retime(curves_of(card), pace.at, pace.at + pace.stride * (frames - 1))
    for node in _showing(scene):
        set_pace_of_images(getattr(node, "image_user", node), frames, pace)


def _showing(scene: bpy.types.Scene) -> list[bpy.types.Node]:
    """The nodes of compositor and card that show the mattes."""
    card = own_object(scene, CARD)
    trees = [getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)]
    trees += [material.node_tree for material in card.data.materials if material is not None] if card is not None else []
    nodes = [node for tree in trees if tree is not None for node in tree.nodes]
    return [node for node in nodes if getattr(node, "image", None) is not None and is_called(node.image, IMAGE)]


def missing_matte(scene: bpy.types.Scene) -> Path | None:
    """The first file of the mattes that the scene shows and that is not there: Blender renders nothing in its place, and says nothing."""
    field = scene.seeing_wind.field_object
    frames = int(field["seeing_wind_frames"]) + 1 if field is not None else 1
    shown = {Path(absolute(node.image.filepath, node.image.library)) for node in _showing(scene)}
    paths = (first.with_name(_name(t)) for first in sorted(shown) for t in range(frames))
    return next((path for path in paths if not path.is_file()), None)


def check_mattes(scene: bpy.types.Scene) -> None:
    """UsageError for mattes that are gone."""
    gone = missing_matte(scene)
    if gone is not None:
        raise UsageError(f"There is no file {gone}, which cuts the edit.", "Put the take back, or set the composite up again.")


def _name(t: int) -> str:
    """Of the matte of a frame, from 0 on."""
    return f"matte_{t + 1:04}.png"


def set_card(scene: bpy.types.Scene, mattes: Mattes | None, depths: Sequence[float]) -> None:
    """A card before the camera, as far away as the object in every frame, that holds out by the matte: it cuts what flies behind.

    Args:
        mattes: None removes it.
        depths: of the object along the camera's axis, one per frame [m].
    """
    card = own_object(scene, CARD)
    if mattes is None:
        if card is not None:
            bpy.data.objects.remove(card)
        return
    if card is None:
        mesh = bpy.data.meshes.new(CARD)
        card = bpy.data.objects.new(CARD, mesh)
        scene.collection.objects.link(card)
        card.hide_select, card.display_type = True, "BOUNDS"
        for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
            setattr(card, f"visible_{ray}", False)
    _shape(card, scene, mattes.window)
    card.parent = scene.camera
    card.data.materials.clear()
    card.data.materials.append(_card_material(mattes))
    remove_curves(card, ["scale"])
    for t, depth in enumerate(depths):
        card.scale = (depth / metres_per_unit(scene),) * 3
        card.keyframe_insert("scale", frame=mattes.pace.at + mattes.pace.stride * t)
    make_linear(card, ["scale"])


def _shape(card: bpy.types.Object, scene: bpy.types.Scene, window: np.ndarray) -> None:
    """As large as what the outlines reach, since every ray that passes it costs time, at a distance of one. Its UV map has the clip's frame
    from 0 to 1, whatever camera renders it."""
    frame = np.array([(corner / -corner.z)[:2] for corner in scene.camera.data.view_frame(scene=scene)])
    low, high = frame.min(axis=0), frame.max(axis=0)
    uv = np.array([[window[i, 0], window[j, 1]] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    card.data.clear_geometry()
    card.data.from_pydata([(x, y, -1.0) for x, y in (low + uv * (high - low)).tolist()], [], [(0, 1, 2, 3)])
    card.data.uv_layers.new().data.foreach_set("uv", uv.astype(np.float32).ravel())


def _card_material(mattes: Mattes) -> bpy.types.Material:
    drop_unused(bpy.data.materials, CARD)
    material = bpy.data.materials.new(CARD)
    material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    nodes.clear()
    place, image, channel, clear, hold, mix, output = (
        nodes.new(f"ShaderNode{kind}")
        for kind in ("TexCoord", "TexImage", "SeparateColor", "BsdfTransparent", "Holdout", "MixShader", "OutputMaterial")
    )
    image.image, image.extension, image.interpolation = mattes.image, "CLIP", "Linear"
    image.image_user.use_auto_refresh = True
    set_pace_of_images(image.image_user, mattes.frames, mattes.pace)
    link(place.outputs["UV"], image.inputs["Vector"])
    link(image.outputs["Color"], channel.inputs[0])
    link(channel.outputs[HELD_OUT], mix.inputs[0])
    link(clear.outputs[0], mix.inputs[1])
    link(hold.outputs[0], mix.inputs[2])
    link(mix.outputs[0], output.inputs["Surface"])
    for column, node in enumerate((place, image, channel, clear, hold, mix, output)):
        node.location = (260 * column, 0)
    return material

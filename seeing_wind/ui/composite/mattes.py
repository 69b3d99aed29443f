"""Mattes of the object in every frame of the clip: they hide the edit behind it, and mask where the clean plate covers it."""

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
"""Channels of a matte: the outline, its edge one pixel soft; and a wider one that includes its shadow rim and motion blur."""
WIDER = 0.012
"""Fraction of the frame's longer side by which `COVERED` extends beyond the outline."""

MARGIN = 3
"""Width in pixels of the soft edge around an outline."""


@dataclass(frozen=True)
class Mattes:
    """The images on disk, and what the compositor needs to show them."""

    image: bpy.types.Image
    frames: int
    pace: Pace
    """The scene frame at which each is shown."""
    window: np.ndarray
    """(2, 2): lower left and upper right corner of the bounding box of the outlines in all frames, as fractions of the frame."""


def mattes_of(scene: bpy.types.Scene, take: Take) -> Mattes | None:
    """Write missing or outdated mattes as PNGs into the take, and load them. None for a take without outlines.

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
    """Check that the images of a composite can be written into the take. Raises TakeError if not."""
    name = take.path.name
    takes.refuse_read_only(
        take.file(FOLDER), f"Save this file into a folder that can be written, put a copy of {name} beside it and try again."
    )


def window_of(masks: Masks) -> np.ndarray:
    """`Mattes.window` of outlines, with a margin for soft edges, which may extend beyond the frame."""
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
    # only around the object: a whole large frame would take seconds
    part = tuple(slice(max(at[0] - wider - 3, 0), at[-1] + wider + 4) for at in (rows, columns))
    found[*part, 0], found[*part, 1] = softened(narrowed(mask[part]), 1), softened(widened(mask[part], wider), 2)
    return found


def narrowed(mask: np.ndarray) -> np.ndarray:
    """A mask (H, W) bool without its outermost pixels, where the background shows as a pale rim; parts thinner than 3 px stay."""
    inner = ~widened(~mask, 1)
    return inner | (mask & ~widened(inner, 2))


def widened(mask: np.ndarray, pixels: int) -> np.ndarray:
    """A mask (H, W) bool grown by `pixels` on every side, by a square."""
    for axis in (0, 1):
        grown = mask.copy()
        for step in range(1, pixels + 1):
            for ahead, behind in ((slice(step, None), slice(None, -step)), (slice(None, -step), slice(step, None))):
                to, source = (ahead, behind) if axis == 0 else ((slice(None), ahead), (slice(None), behind))
                grown[to] |= mask[source]
        mask = grown
    return mask


def softened(mask: np.ndarray, pixels: int) -> np.ndarray:
    """A mask (H, W) bool with edges softened over `pixels`, as (H, W) uint8."""
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
    """Retime the mattes in a scene's compositor and on its card to another pace."""
    card = own_object(scene, CARD)
    frames = int(scene.seeing_wind.field_object["seeing_wind_frames"]) + 1
    if card is not None:
        retime(curves_of(card), pace.at, pace.at + pace.stride * (frames - 1))
    for node in _showing(scene):
        set_pace_of_images(getattr(node, "image_user", node), frames, pace)


def _showing(scene: bpy.types.Scene) -> list[bpy.types.Node]:
    """The nodes in compositor and card material that show the mattes."""
    card = own_object(scene, CARD)
    trees = [getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)]
    trees += [material.node_tree for material in card.data.materials if material is not None] if card is not None else []
    nodes = [node for tree in trees if tree is not None for node in tree.nodes]
    return [node for node in nodes if getattr(node, "image", None) is not None and is_called(node.image, IMAGE)]


def missing_matte(scene: bpy.types.Scene) -> Path | None:
    """The first missing file of the mattes that the scene uses, if any: Blender would silently render nothing in its place."""
    field = scene.seeing_wind.field_object
    frames = int(field["seeing_wind_frames"]) + 1 if field is not None else 1
    shown = {Path(absolute(node.image.filepath, node.image.library)) for node in _showing(scene)}
    paths = (first.with_name(_name(t)) for first in sorted(shown) for t in range(frames))
    return next((path for path in paths if not path.is_file()), None)


def check_mattes(scene: bpy.types.Scene) -> None:
    """Raise UsageError if a matte file is missing."""
    gone = missing_matte(scene)
    if gone is not None:
        raise UsageError(f"There is no file {gone}, which cuts the edit.", "Put the take back, or set the composite up again.")


def _name(t: int) -> str:
    """File name of the matte of clip frame `t`."""
    return f"matte_{t + 1:04}.png"


def set_card(scene: bpy.types.Scene, mattes: Mattes | None, depths: Sequence[float]) -> None:
    """Set a holdout card with the matte in front of the camera, at the object's distance in every frame: it hides what passes behind.

    Args:
        mattes: None removes the card.
        depths: of the object along the camera's axis, one per clip frame [m].
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
    """Make the card cover just the window of the outlines, at distance 1, since every ray through it costs time. Its UV map spans the
    clip's frame from 0 to 1, whatever camera renders it."""
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

"""The settings of the step *Object*, and a model's answers about the clip.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatVectorProperty, IntProperty, PointerProperty, StringProperty

from ....engine.settings import BuildSettings, ObserveSettings, options_of
from ....engine.settings.build import MADE
from ...option_properties import with_options
from ...property_kinds import KEPT, MATERIAL_ITEMS, PART_ITEMS, PATH, changed, choice, is_mesh, toggle
from ..properties import OF_THE_CLIP

NUMBERS = [one.name for one in options_of(BuildSettings).values() if one.group == MADE and one.kind is float]
"""Names of the numbers that describe a material."""


@with_options(BuildSettings)
@with_options(ObserveSettings, but=OF_THE_CLIP)
# a wide range, so that an invalid value stays visible and gets an error text; Blender would silently turn 0 into 0.01
@with_options(ObserveSettings, only=("distance",), min=-1.0e6, soft_min=0.01)
class ObjectOptions:
    """Which object, its scale and its material: settings of a scene, and keyword arguments of Recover."""

    object_mode: choice("Object", "How the object is marked in the first frame", [
        ("BOX", "Box", "A box round the object, in pixels"),
        ("BLENDER_MASK", "Blender Mask", "A mask drawn in the Movie Clip or Image Editor"),
        ("PLANE", "Plane Track", "The inside of the clip's active plane track in the first frame"),
        ("PROXY", "Proxy Mesh", "The outline of the proxy mesh as the camera sees it"),
        ("MASK", "Mask File", "A PNG of the first frame, non-zero where the object is"),
    ])  # fmt: skip
    held_mode: choice("Held Places", "How the place is marked at which the object is held", [
        ("FILE", "Image", "A PNG of the first frame, non-zero where the object is held; without one it is held nowhere"),
        ("BOX", "Box", "A box round the held part, in pixels of the first frame"),
        ("BLENDER_MASK", "Blender Mask", "A mask drawn round the held part in the Movie Clip or Image Editor"),
    ])  # fmt: skip
    held_box: FloatVectorProperty(
        name="Held Box (px)", size=4, options=KEPT, update=changed,
        description="Left, top, right, bottom of the held part in pixels of the first frame",
    )  # fmt: skip
    use_tracks: toggle("Tracks", "Follow the object by the tracks and plane tracks of the Movie Clip Editor instead of the engine's own")

    scale_mode: choice("Scale", "What gives the size of things", [
        ("AUTO", "Automatic", "As far away as the world's origin with a camera solve or a scene camera, else at the distance below"),
        ("DISTANCE", "Distance", "The distance from the camera to the object is known"),
        ("PIXELS", "Pixels per Metre", "The image scale in the object's plane is known"),
        ("PROXY", "Proxy Mesh", "A mesh of the scene stands where the object is in the first frame and gives the depth of each pixel"),
    ])  # fmt: skip
    material: choice("Material", "What the object is made of", MATERIAL_ITEMS, BuildSettings.material)
    head_material: choice("Head Material", "What the part is made of that a stem carries, such as a flower", PART_ITEMS)
    leaf_material: choice("Leaf Material", "What the leaves beside a stem are made of", PART_ITEMS)


@with_options(BuildSettings, only=("law",))
@with_options(BuildSettings, only=NUMBERS, ticks=False, default=0.0, min=0.0)
class SEEING_WIND_PG_guess(bpy.types.PropertyGroup):
    """A thing that a vision-language model saw in the clip's first frame; `name` is what it is called."""

    made_of: StringProperty(name="Made Of", description="Its material, in the model's words")
    mask: StringProperty(name="Mask", subtype="FILE_PATH", description="Where it is in the first frame")


class SEEING_WIND_PG_verdict(bpy.types.PropertyGroup):
    """What the engine says of an item of its preview; `name` is the item."""

    doubtful: BoolProperty(name="Doubtful", description="Whether it makes the result worse")
    because: StringProperty(name="Because", description="What was seen")
    advice: StringProperty(name="What to Do", description="What would make it better")


class SEEING_WIND_PG_correction(bpy.types.PropertyGroup):
    """A point by which the outline is corrected in one frame."""

    clip_frame: IntProperty(name="Clip Frame", min=0, description="Counted from 0 in the file")
    place: FloatVectorProperty(name="Place (px)", size=2, description="From the left and from the top")
    beside: BoolProperty(name="Off the Object", description="The point is not on the object")


class ObjectSettings:
    """Settings that only a scene has: datablocks, which Recover takes by name, a preview's verdicts, and a model's answers."""

    mask_data: PointerProperty(
        name="Mask Data", type=bpy.types.Mask, description="Closed splines round the object in the first frame", update=changed
    )
    held_mask: PointerProperty(
        name="Held Mask", type=bpy.types.Mask, description="Closed splines round the held part in the first frame", update=changed
    )
    proxy: PointerProperty(
        name="Proxy", type=bpy.types.Object, poll=is_mesh, update=changed,
        description="A mesh that stands where the object is in the first frame, as the camera sees it",
    )  # fmt: skip

    outline_data: PointerProperty(
        name="Outline Mask", type=bpy.types.Mask, update=changed,
        description="Closed splines round the object in a later frame, by which the outline is mended",
    )  # fmt: skip
    corrections: CollectionProperty(type=SEEING_WIND_PG_correction)

    verdicts: CollectionProperty(type=SEEING_WIND_PG_verdict)
    previewed_take: StringProperty(
        name="Previewed Take", subtype="FILE_PATH", options=PATH, description="Folder that the preview is in"
    )
    preview_image: PointerProperty(name="Preview", type=bpy.types.Image, description="Outline, tracks, held place and scale as seen")
    previewed_digest: StringProperty(description="Of the settings that the preview was made with")
    foreseen_digest: StringProperty(description="Of those that it foresaw the solve with")
    proposed_pin: StringProperty(
        name="Proposed Held Place", subtype="FILE_PATH", options=PATH, description="Where the object seems to be held"
    )

    guesses: CollectionProperty(type=SEEING_WIND_PG_guess)
    active_guess: IntProperty(name="Active Guess", default=0, min=0)


CLASSES = (SEEING_WIND_PG_guess, SEEING_WIND_PG_verdict, SEEING_WIND_PG_correction)

"""The settings of the step *Object*, and what a model saw in the clip.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatVectorProperty, IntProperty, PointerProperty, StringProperty

from ....engine.settings import BuildSettings
from ...property_kinds import KEPT, LAW_ITEMS, MATERIAL_ITEMS, changed, choice, file_path, is_mesh, number, toggle


class ObjectOptions:
    """Which object, at what scale, made of what: settings of a scene, and keyword arguments of Recover."""

    object_mode: choice("Object", "How the object is marked in the first picture", [
        ("BOX", "Box", "A box round the object, in pixels"),
        ("BLENDER_MASK", "Blender Mask", "A mask drawn in the Movie Clip or Image Editor"),
        ("PLANE", "Plane Track", "The inside of the clip's active plane track in the first picture"),
        ("PROXY", "Proxy Mesh", "The outline of the proxy mesh as the camera sees it"),
        ("MASK", "Mask File", "A PNG of the first picture, non-zero where the object is"),
    ])  # fmt: skip
    box: FloatVectorProperty(
        name="Box (px)", size=4, default=(0.0, 0.0, 0.0, 0.0), min=0.0, precision=0, step=100, options=KEPT, update=changed,
        description="Left, top, right, bottom in pixels of the first picture, the origin at its top left",
    )  # fmt: skip
    mask: file_path("Mask", "PNG of the first picture, non-zero where the object is")
    use_tracks: toggle("Tracks", "Follow the object by the tracks and plane tracks of the Movie Clip Editor instead of by our own")
    pin: file_path("Held Places", "Optional PNG of the first picture, non-zero where the object is held in place")

    scale_mode: choice("Scale", "What gives the size of things", [
        ("AUTO", "Automatic", "A camera solve or scene camera sees the object as far away as the world's origin; else the distance below"),
        ("DISTANCE", "Distance", "The distance from the camera to the object is known"),
        ("PIXELS", "Pixels per Metre", "The image scale in the object's plane is known"),
        ("PROXY", "Proxy Mesh", "A mesh of the scene stands where the object is in the first picture and gives the depth of each pixel"),
    ])  # fmt: skip
    distance: number("Distance (m)", 2.0, "Metres from the camera to the object", min=0.001, soft_max=100.0, step=10, precision=3)
    pixels_per_metre: number(
        "Scale (px/m)", 400.0, "Pixels per metre in the object's plane", min=0.01, soft_max=10000.0, step=1000, precision=1
    )

    material: choice("Material", "What the object is made of", MATERIAL_ITEMS, BuildSettings.material)
    use_density: toggle("Density", "Replace the preset's density")
    density: number("Density (kg/m³)", 1000.0, "Kilograms per cubic metre", min=0.01, soft_max=20000.0, step=1000, precision=1)
    use_youngs_modulus: toggle("Stiffness", "Replace the preset's Young's modulus")
    youngs_modulus: number("Stiffness (Pa)", 1e5, "Young's modulus in pascals", min=1.0, soft_max=1e10, step=100000, precision=0)
    law: choice("Behaves As", "How the object answers to forces", LAW_ITEMS)
    use_poisson_ratio: toggle("Poisson's Ratio", "Replace the preset's Poisson's ratio")
    poisson_ratio: number(
        "Poisson's Ratio", 0.3, "How much it narrows when stretched: 0 cork, 0.3 most things, 0.49 rubber", min=0.0, max=0.495, precision=3
    )
    use_yield_stress: toggle("Yield Stress", "Replace the preset's yield stress (for what keeps dents or flows)")
    yield_stress: number(
        "Yield Stress (Pa)", 1e4, "Stress from which it keeps its new shape", min=1.0, soft_max=1e9, step=100000, precision=0
    )
    use_viscosity: toggle("Viscosity", "Replace the preset's viscosity (for what flows)")
    viscosity: number("Viscosity (Pa s)", 100.0, "How slowly it flows under load", min=0.01, soft_max=1e8, step=1000, precision=2)
    use_thickness: toggle("Thickness", "Give the body's thickness instead of guessing it from the silhouette")
    thickness: number("Thickness (m)", 0.01, "Metres of body behind the visible surface", min=1e-5, soft_max=1.0, step=0.1, precision=4)


class SEEING_WIND_PG_guess(bpy.types.PropertyGroup):
    """A thing that a vision-language model saw in the clip's first picture; `name` is what it is called."""

    made_of: StringProperty(name="Made Of", description="Its material, in the model's words")
    mask: StringProperty(name="Mask", subtype="FILE_PATH", description="Where it is in the first picture")
    law: choice("Behaves As", "How it answers to forces", LAW_ITEMS)
    density: number("Density (kg/m³)", 0.0, "As the model sees it", min=0.0, precision=1)
    youngs_modulus: number("Stiffness (Pa)", 0.0, "As the model sees it", min=0.0, precision=0)
    poisson_ratio: number("Poisson's Ratio", 0.0, "As the model sees it", min=0.0, max=0.495, precision=3)
    yield_stress: number("Yield Stress (Pa)", 0.0, "As the model sees it; 0 for none", min=0.0, precision=0)
    viscosity: number("Viscosity (Pa s)", 0.0, "As the model sees it; 0 for none", min=0.0, precision=2)


class SEEING_WIND_PG_verdict(bpy.types.PropertyGroup):
    """What the engine says of an item of its preview; `name` is the item."""

    doubtful: BoolProperty(name="Doubtful", description="Whether it makes the result worse")
    because: StringProperty(name="Because", description="What was seen")
    advice: StringProperty(name="What to Do", description="What would make it better")


class ObjectSettings:
    """What only the scene has: datablocks, which Recover takes by their names, a preview's verdicts, and a model's answers."""

    mask_data: PointerProperty(
        name="Mask Data", type=bpy.types.Mask, description="Closed splines round the object in the first picture", update=changed
    )
    proxy: PointerProperty(
        name="Proxy", type=bpy.types.Object, poll=is_mesh, update=changed,
        description="A mesh that stands where the object is in the first picture, as the camera sees it",
    )  # fmt: skip

    verdicts: CollectionProperty(type=SEEING_WIND_PG_verdict)
    previewed_take: StringProperty(name="Previewed Take", subtype="FILE_PATH", description="Folder that the preview is in")
    previewed_picture: PointerProperty(name="Preview", type=bpy.types.Image, description="Outline, tracks, held place and scale as seen")
    previewed_digest: StringProperty(description="Of the settings that the preview was made with")
    proposed_pin: StringProperty(name="Proposed Held Place", subtype="FILE_PATH", description="Where the object seems to be held")

    guesses: CollectionProperty(type=SEEING_WIND_PG_guess)
    active_guess: IntProperty(name="Active Guess", default=0, min=0)


CLASSES = (SEEING_WIND_PG_guess, SEEING_WIND_PG_verdict)

"""The settings of the composite that stay with the scene.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..property_kinds import KEPT, PATH

BEHIND = [
    ("AUTO", "Automatic", "The clip, or the clean plate when the clip's own object is simulated anew"),
    ("CLIP", "Clip", "The clip as it is"),
    ("PLATE", "Clean Plate", "The clip, with its object covered by what was behind it"),
]

SAMPLES = "Of Cycles, per pixel, given to the scene when this is changed, or when it has none of its own"


class Look:
    """How the edit is put over the clip: properties of the scene, and of the operator *Set Up Composite*."""

    behind: EnumProperty(name="Behind", items=BEHIND, options=KEPT, description="What is seen behind the edit")
    floor: BoolProperty(
        name="Floor", options=KEPT, description="A plane under the edit that catches its shadows; move it to where the clip's floor is"
    )
    wall: BoolProperty(
        name="Wall", options=KEPT,
        description="An upright plane behind the edit that catches its shadows; move and turn it to where the clip's wall is",
    )  # fmt: skip
    samples: IntProperty(name="Samples", default=32, min=1, soft_max=512, step=16, options=KEPT, description=SAMPLES)
    shutter: FloatProperty(
        name="Shutter (frames)", default=0.5, min=0.0, soft_max=1.0, options=KEPT,
        description="How long the clip's shutter was open: 0.5 is a shutter of 180 degrees; 0 renders no motion blur",
    )  # fmt: skip
    fstop: FloatProperty(
        name="Aperture (f-stop)", default=0.0, min=0.0, soft_max=22.0, precision=1, options=KEPT,
        description="Of the clip's lens, as on a sensor 36 mm wide: what is nearer or farther than the clip's object blurs; 0: none does",
    )  # fmt: skip
    grain: FloatProperty(
        name="Grain Factor", default=1.0, min=0.0, soft_max=2.0, options=KEPT,
        description="Factor on the clip's own noise, which is measured and put on what is not the clip; 0 leaves it clean",
    )  # fmt: skip
    soft: FloatProperty(
        name="Softness Factor", default=1.0, min=0.0, soft_max=2.0, options=KEPT,
        description="Factor on how softly the clip shows the object's rim, which is measured and given to the render; 0: Blender's filter",
    )  # fmt: skip
    show_field: BoolProperty(name="Show Arrows", options=KEPT, description="Render the field's arrows too")
    use_cycles: BoolProperty(
        name="Use Cycles", default=True, options=KEPT,
        description="Render with Cycles, which alone catches shadows; otherwise the scene keeps its own engine",
    )  # fmt: skip
    use_standard: BoolProperty(
        name="Standard View", default=True, options=KEPT,
        description="The view transform Standard without look, exposure, gamma, curves and white balance leaves the clip's colors as "
        "they were filmed; otherwise the scene keeps its own",
    )  # fmt: skip


LOOK = ("behind", "floor", "wall", "samples", "shutter", "fstop", "grain", "soft", "show_field", "use_cycles", "use_standard")
"""Names of all properties of `Look`, in the panel's order."""


class SEEING_WIND_PG_composite(Look, bpy.types.PropertyGroup):
    """What the scene keeps of it."""


class CompositeSettings:
    """The scene's composite settings: the look of the edit, and the panorama that lights it."""

    composite: PointerProperty(type=SEEING_WIND_PG_composite, description="How the edit is put over the clip")
    composite_said: StringProperty(options={"HIDDEN"}, description="What was set up last")
    composite_as: StringProperty(options={"HIDDEN"}, description="By which settings")
    composite_samples: IntProperty(
        default=32, options={"HIDDEN"}, description="Samples of the look at that time: where it has others now, they are the scene's, too"
    )
    hdri: StringProperty(
        name="HDRI", subtype="FILE_PATH", options=PATH,
        description="A panorama (.hdr or .exr) of where the clip was filmed, which lights the edit; empty: the sun and sky of the clip",
    )  # fmt: skip
    hdri_turn: FloatProperty(
        name="Turn (degrees)", subtype="ANGLE", options={"SKIP_SAVE"},
        description="How far the panorama is turned round the vertical, so that its sun stands where the clip's does",
    )  # fmt: skip
    hdri_strength: FloatProperty(
        name="HDRI Strength", default=1.0, min=0.0, soft_max=10.0, options={"SKIP_SAVE"},
        description="Factor on the panorama's light, so that the edit is as bright as the clip",
    )  # fmt: skip
    former_world: PointerProperty(type=bpy.types.World, options={"HIDDEN"})


CLASSES = (SEEING_WIND_PG_composite,)

"""The settings of the step *Recover*, and what a scene notes of its results. Names, units and defaults are those of the command line.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import FloatVectorProperty, IntProperty, PointerProperty, StringProperty

from ...engine.conventions import GRAVITY
from ...engine.settings import FLOWING_PARTICLES, PARTICLES, RecoverSettings
from ..clip.object.properties import ObjectOptions
from ..clip.properties import ClipOptions
from ..property_kinds import KEPT, PATH, changed, choice

IMPLIED = {
    "frames": ("use_frames", True),
    "box": ("object_mode", "BOX"),
    "mask": ("object_mode", "MASK"),
    "distance": ("scale_mode", "DISTANCE"),
    "pixels_per_metre": ("scale_mode", "PIXELS"),
    "fov": ("camera_mode", "FOV"),
    "camera": ("camera_mode", "JSON"),
    "gravity": ("gravity_mode", "CUSTOM"),
    "density": ("use_density", True),
    "youngs_modulus": ("use_youngs_modulus", True),
    "poisson_ratio": ("use_poisson_ratio", True),
    "yield_stress": ("use_yield_stress", True),
    "viscosity": ("use_viscosity", True),
    "thickness": ("use_thickness", True),
}
"""A keyword argument that chooses a mode as well, unless the mode is given too."""


class RecoverOptions(ClipOptions, ObjectOptions):
    """All options of Recover: a scene has them as settings, the operator as keyword arguments."""

    gravity_mode: choice("Gravity", "Known acceleration that is not part of the recovered field", [
        ("SCENE", "Scene", "The scene's gravity, if it is on"),
        ("NONE", "None", "Gravity counts as part of the field"),
        ("CUSTOM", "Custom", "An acceleration of your own"),
    ])  # fmt: skip
    gravity: FloatVectorProperty(
        name="Gravity (m/s²)", size=3, default=GRAVITY, soft_min=-20.0, soft_max=20.0, step=10, options=KEPT, update=changed,
        description="Acceleration along world X, Y, Z in metres per square second",
    )  # fmt: skip

    take: StringProperty(
        name="Take", subtype="DIR_PATH", options=PATH, update=changed,
        description="Folder of the results; empty: CLIP.take beside the .blend file, or in the temporary folder while it is unsaved",
    )  # fmt: skip
    iterations: IntProperty(
        name="Iterations", default=RecoverSettings.iterations, min=1, soft_max=50, options=KEPT, update=changed,
        description="Gauss-Newton iterations at most; 1 gives a draft",
    )  # fmt: skip
    refine: IntProperty(
        name="Refine", default=RecoverSettings.refine, min=0, max=10_000, soft_max=50, options=KEPT, update=changed,
        description="Steps by which the stored field is refined through the simulator, so that re-simulations stray less; 0 is off",
    )  # fmt: skip
    particles: IntProperty(
        name="Particles", default=0, min=0, max=100_000, soft_max=5000, step=50, options=KEPT, update=changed,
        description=f"About how many particles stand for the object: more see finer bends and take longer. 0 is {PARTICLES}, "
        f"or {FLOWING_PARTICLES} where the material flows",
    )  # fmt: skip
    seed: IntProperty(name="Seed", default=0, min=0, description="Of every random choice", options=KEPT, update=changed)


class RecoverResults:
    """What was made, and with which settings: part of the file and of its undo."""

    unfinished: StringProperty(options={"HIDDEN"}, description="The step whose job runs: says after a reopening that it was cut off")
    recovered_digest: StringProperty(options={"HIDDEN"})
    recovered_take: StringProperty(options={"HIDDEN"}, description="The take that the scene shows")
    recovered_stamp: StringProperty(options={"HIDDEN"}, description="Of its field: tells when another one has taken its place")
    started_take: StringProperty(options={"HIDDEN"}, description="Where the last Recover of this scene went")
    field_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    arrows_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    recovered_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    camera_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})


OPTIONS = tuple(name for base in (ClipOptions, ObjectOptions, RecoverOptions) for name in base.__annotations__)
"""Names of all options of Recover."""


def adopt(settings: bpy.types.PropertyGroup, arguments: bpy.types.OperatorProperties) -> None:
    """Take over the options that an operator was called with, and the modes that they imply."""
    given = [name for name in OPTIONS if arguments.is_property_set(name)]
    for name in given:
        mode, value = IMPLIED.get(name, ("", None))
        if mode and mode not in given:
            setattr(settings, mode, value)
    for name in given:
        setattr(settings, name, getattr(arguments, name))

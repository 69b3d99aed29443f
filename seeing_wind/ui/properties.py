"""The settings of a scene. Names, units and defaults are those of the engine's command line.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from ..engine.conventions import DEFAULT_FOV_DEGREES, GRAVITY
from ..engine.settings import FLOWING_PARTICLES, PARTICLES, BuildSettings, RecoverSettings
from .edit import edits
from .property_kinds import KEPT, KINDS, LAW_ITEMS, MATERIAL_ITEMS, PATH, WAYS, changed, choice, file_path, is_mesh, number, toggle

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


class ClipOptions:
    """The options of Recover: a scene has them as settings, the operator as keyword arguments."""

    clip: file_path("Clip", "The video in which something is moved by forces that nobody sees")
    fps: number("FPS (1/s)", 0.0, "Frames per second of the clip; 0 takes what the file says", min=0.0, soft_max=240.0, step=100)
    use_frames: toggle("Part of the Clip", "Use only some of the clip's pictures")
    frames: IntVectorProperty(
        name="Pictures",
        size=2,
        default=(0, 40),
        min=0,
        description="First and last picture, both inclusive, counted from 0",
        options=KEPT,
        update=changed,
    )

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
    camera_mode: choice("Camera", "What is known of the camera", [
        ("AUTO", "Automatic", "The clip's camera solve if it has one, else the field of view"),
        ("SOLVE", "Camera Solve", "The solve of the Movie Clip Editor, placed as the camera with the Camera Solver constraint is"),
        ("SCENE", "Scene Camera", "The scene's camera, at each frame"),
        ("FOV", "Field of View", "A level camera that stands still and looks along +Y"),
        ("JSON", "File", "JSON with width height fx fy cx cy and camera_to_world"),
    ])  # fmt: skip
    fov: number("FOV (°)", DEFAULT_FOV_DEGREES, "Horizontal field of view in degrees", min=1.0, max=170.0, step=100, precision=1)
    camera: file_path("Camera File", "JSON: width height fx fy cx cy, camera_to_world (4x4, OpenCV axes, one or one per picture)")

    gravity_mode: choice("Gravity", "Known acceleration that is not part of the recovered field", [
        ("SCENE", "Scene", "The scene's gravity, if it is on"),
        ("NONE", "None", "Gravity counts as part of the field"),
        ("CUSTOM", "Custom", "An acceleration of your own"),
    ])  # fmt: skip
    gravity: FloatVectorProperty(
        name="Gravity (m/s²)", size=3, default=GRAVITY, soft_min=-20.0, soft_max=20.0, step=10, options=KEPT, update=changed,
        description="Acceleration along world X, Y, Z in metres per square second",
    )  # fmt: skip

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


class SEEING_WIND_PG_body(bpy.types.PropertyGroup):
    """One body of the edit: a mesh object, or the clip's own object."""

    is_recovered: BoolProperty(name="Recovered Object", description="The object of the clip itself, at its recovered material")
    object: PointerProperty(name="Object", type=bpy.types.Object, poll=is_mesh, description="The mesh to move", update=changed)
    material: choice("Material", "What the body is made of", MATERIAL_ITEMS, BuildSettings.material)
    use_density: toggle("Density", "Replace the preset's density")
    density: number("Density (kg/m³)", 1000.0, "Kilograms per cubic metre", min=0.01, soft_max=20000.0, step=1000, precision=1)
    use_mass: toggle("Mass", "Give the mass of the whole body instead of its density")
    mass: number("Mass (kg)", 0.1, "Kilograms of the whole body", min=1e-6, soft_max=1000.0, step=1, precision=4)
    use_youngs_modulus: toggle("Stiffness", "Replace the preset's Young's modulus")
    youngs_modulus: number("Stiffness (Pa)", 1e5, "Young's modulus in pascals", min=1.0, soft_max=1e10, step=100000, precision=0)
    mass_scale: number(
        "Mass Factor", 1.0, "2 doubles the mass: half the acceleration in the same wind", min=0.001, soft_max=100.0, step=10, precision=3
    )
    stiffness_scale: number(
        "Stiffness Factor", 1.0, "Factor on Young's modulus: 2 is twice as stiff", min=0.001, soft_max=100.0, step=10, precision=3
    )
    pin_group: StringProperty(
        name="Pinned", update=changed,
        description="Vertex group whose vertices are held in place: weight 1 holds firmly, less draws back like a spring",
    )  # fmt: skip
    free_mode: choice("Holds of the Clip", "What becomes of the places at which the object was held in the clip", [
        ("KEEP", "Keep", "The object stays held where it was held in the clip"),
        ("ALL", "Let Go", "Nothing holds the object any more, but for its pinned vertices"),
        ("GROUP", "Let Go of a Group", "The vertices of a group are let go"),
    ])  # fmt: skip
    free_group: StringProperty(name="Freed", description="Vertex group of the vertices that are let go", update=changed)
    use_velocity: toggle("Velocity", "Start with a velocity of its own instead of at rest (or as recovered)")
    velocity: FloatVectorProperty(
        name="Velocity (m/s)", size=3, soft_min=-20.0, soft_max=20.0, step=10, description="At the start", update=changed
    )
    start_frame: IntProperty(
        name="Start Picture", default=0, min=0, description="The body stands still before this picture of the clip", update=changed
    )

    result: StringProperty(options={"HIDDEN"}, description="Name of the body in the last re-simulation")
    baked_copy: PointerProperty(type=bpy.types.Object, options={"HIDDEN"}, description="Carries the motion where the object itself cannot")


class SEEING_WIND_PG_collider(bpy.types.PropertyGroup):
    """Something that stands in the bodies' way and is not moved by them."""

    object: PointerProperty(
        name="Object", type=bpy.types.Object, poll=is_mesh, description="The mesh that the bodies collide with", update=changed
    )
    kind: choice("Contact", "What happens at its surface", KINDS)
    friction: number("Friction", 0.3, "Coulomb's coefficient: 0 is ice, 1 is rubber", min=0.0, soft_max=1.0, step=5, precision=2)


class EditOptions:
    """One edit: the scene has the one that is worked on, and keeps the others to compare with."""

    bodies: CollectionProperty(type=SEEING_WIND_PG_body)
    active_body: IntProperty(name="Active Body", default=0, min=0)
    colliders: CollectionProperty(type=SEEING_WIND_PG_collider)
    active_collider: IntProperty(name="Active Collider", default=0, min=0)
    use_floor: toggle("Floor", "A level floor under everything")
    floor_height: number("Height (m)", 0.0, "Of the floor, along world Z", soft_min=-10.0, soft_max=10.0, step=1, precision=3)
    floor_friction: number("Friction", 0.3, "Of the floor: 0 is ice, 1 is rubber", min=0.0, soft_max=1.0, step=5, precision=2)
    field_strength: number(
        "Field Strength", 1.0, "Factor on the recovered field; its keyframes count", options=KEPT | {"ANIMATABLE"},
        soft_min=-5.0, soft_max=5.0, step=10, precision=2,
    )  # fmt: skip
    edit_gravity_mode: choice("Gravity", "Gravity in the re-simulation", [
        ("SAME", "As Recovered", "The gravity that Recover was given"),
        ("NONE", "None", "No gravity"),
        ("CUSTOM", "Custom", "An acceleration of your own"),
    ])  # fmt: skip
    edit_gravity: FloatVectorProperty(
        name="Gravity (m/s²)", size=3, default=GRAVITY, soft_min=-20.0, soft_max=20.0, step=10, update=changed,
        description="Acceleration along world X, Y, Z in the re-simulation",
    )  # fmt: skip
    contact: BoolProperty(name="Contact", default=False, description="Bodies push each other; off: each moves alone", update=changed)
    offset: FloatVectorProperty(
        name="Offset (m)", size=3, soft_min=-10.0, soft_max=10.0, step=10, update=changed,
        description="Where this edit is shown, to stand beside another; it is simulated at the place that it was copied from",
    )  # fmt: skip

    edit_folder: StringProperty(options={"HIDDEN"})
    simulated_digest: StringProperty(options={"HIDDEN"})
    simulated_take: StringProperty(options={"HIDDEN"})
    baked_digest: StringProperty(options={"HIDDEN"})


class SEEING_WIND_PG_edit(EditOptions, bpy.types.PropertyGroup):
    """An edit that is kept while another one is worked on."""


def _switch_edit(self, context) -> None:
    edits.switch(self)


class SEEING_WIND_PG_scene(ClipOptions, EditOptions, bpy.types.PropertyGroup):
    """`scene.seeing_wind`."""

    mask_data: PointerProperty(
        name="Mask Data", type=bpy.types.Mask, description="Closed splines round the object in the first picture", update=changed
    )
    proxy: PointerProperty(
        name="Proxy", type=bpy.types.Object, poll=is_mesh, update=changed,
        description="A mesh that stands where the object is in the first picture, as the camera sees it",
    )  # fmt: skip

    guesses: CollectionProperty(type=SEEING_WIND_PG_guess)
    active_guess: IntProperty(name="Active Guess", default=0, min=0)

    edits: CollectionProperty(type=SEEING_WIND_PG_edit)
    active_edit: IntProperty(name="Active Edit", default=0, min=0, update=_switch_edit)
    loaded_edit: IntProperty(options={"HIDDEN"}, default=0, min=0, description="The edit whose settings the scene has now")

    bake_way: choice("Keyframes", "How the motion is kept", WAYS)
    bake_use_frames: toggle("Part of the Motion", "Bake only some of the scene's frames")
    bake_frames: IntVectorProperty(
        name="Frames", size=2, default=(1, 40), options=KEPT, update=changed, description="First and last scene frame, both inclusive"
    )
    bake_tolerance: number(
        "Rigid Within (%)", 0.2, "A body counts as rigid while it bends by less than this part of its size", min=0.0, soft_max=5.0, step=10,
        precision=2,
    )  # fmt: skip

    frame_start: IntProperty(
        name="First Frame", default=1, description="Scene frame of the clip's first picture; takes effect at the next Recover or Reload"
    )
    field_resolution: IntProperty(
        name="Field Nodes", default=7, min=2, max=12, description="Wind sources along each side of the field object"
    )

    # What was made, and with which settings: part of the file and of its undo.
    unfinished: StringProperty(options={"HIDDEN"}, description="The step whose job runs: says after a reopening that it was cut off")
    recovered_digest: StringProperty(options={"HIDDEN"})
    recovered_take: StringProperty(options={"HIDDEN"}, description="The take that the scene shows")
    recovered_stamp: StringProperty(options={"HIDDEN"}, description="Of its field: tells when another one has taken its place")
    started_take: StringProperty(options={"HIDDEN"}, description="Where the last Recover of this scene went")
    field_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    arrows_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    recovered_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    camera_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})


def adopt(settings: SEEING_WIND_PG_scene, arguments: bpy.types.OperatorProperties) -> None:
    """Take over the options that an operator was called with, and the modes that they imply."""
    given = [name for name in ClipOptions.__annotations__ if arguments.is_property_set(name)]
    for name in given:
        mode, value = IMPLIED.get(name, ("", None))
        if mode and mode not in given:
            setattr(settings, mode, value)
    for name in given:
        setattr(settings, name, getattr(arguments, name))


CLASSES = (SEEING_WIND_PG_guess, SEEING_WIND_PG_body, SEEING_WIND_PG_collider, SEEING_WIND_PG_edit, SEEING_WIND_PG_scene)

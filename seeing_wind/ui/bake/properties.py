"""The settings of the step *Bake*.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from bpy.props import IntProperty, IntVectorProperty

from ..property_kinds import KEPT, WAYS, changed, choice, number, toggle


class BakeSettings:
    """How to bake, and which frames."""

    bake_way: choice("Keyframes", "How the motion is kept", WAYS)
    bake_use_frames: toggle("Part of the Motion", "Bake only some of the scene's frames")
    bake_frames: IntVectorProperty(
        name="Frames", size=2, default=(1, 40), options=KEPT, update=changed, description="First and last scene frame, both inclusive"
    )
    bake_smooth: IntProperty(
        name="Smooth", default=4, min=0, soft_max=10, options=KEPT, update=changed,
        description="Passes that smooth ripples as short as one mesh edge, which would render as a quilt, out of the motion; bends stay. "
        "0: none. Cloth is never smoothed",
    )  # fmt: skip
    bake_tolerance: number(
        "Rigid Within (%)", 0.2, "A body counts as rigid while it bends by less than this part of its size", min=0.0, soft_max=5.0, step=10,
        precision=2,
    )  # fmt: skip

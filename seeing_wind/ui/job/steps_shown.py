"""Which steps the sidebar shows unfolded: those that the work has gone past fold, so that the next one is in sight.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from bpy.props import BoolProperty

PAST = {"recover": ("clip", "object"), "resimulate": ("clip", "object", "recover")}
"""Steps that fold once one is done. An edit stays with what it was simulated for."""


def _shown():
    return BoolProperty(default=True, options={"HIDDEN"}, description="Whether the panel of the step is unfolded")


class StepsShown:
    """Of the scene's settings; the panels' titles change them."""

    shows_clip: _shown()
    shows_object: _shown()
    shows_recover: _shown()
    shows_edit: _shown()
    shows_resimulate: _shown()
    shows_bake: _shown()


def fold_past(settings, step: str) -> None:
    """`step` is done: fold what lies behind it."""
    for past in PAST.get(step, ()):
        setattr(settings, f"shows_{past}", False)

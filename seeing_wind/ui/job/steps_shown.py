"""Which steps the sidebar shows unfolded: steps that the work has gone past are folded, so that the next one is in sight.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from bpy.props import BoolProperty

PAST = {"recover": ("clip", "object"), "resimulate": ("clip", "object", "recover")}
"""Steps that are folded once the step of the key is done. The step *Edit* stays unfolded after a re-simulation."""


def _shown():
    return BoolProperty(default=True, options={"HIDDEN"}, description="Whether the panel of the step is unfolded")


class StepsShown:
    """Part of the scene's settings: which steps are unfolded, changed by the panels' titles."""

    shows_clip: _shown()
    shows_object: _shown()
    shows_recover: _shown()
    shows_edit: _shown()
    shows_resimulate: _shown()
    shows_bake: _shown()


def fold_past(settings, step: str) -> None:
    """Fold the steps that are past once `step` is done."""
    for past in PAST.get(step, ()):
        setattr(settings, f"shows_{past}", False)

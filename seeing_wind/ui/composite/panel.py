"""The panel *Composite*."""

from ..job.panel_pieces import Tab, columns, draw_text, fold, panels
from .own import camera_changes, changes, samples_for
from .properties import LOOK

IN_SIGHT = ("floor", "wall", "use_cycles", "use_standard")
"""Of the look, what is not folded away."""


class CompositeTab(Tab):
    """The edit over the clip."""

    bl_label = "Composite"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """Only when the scene has a clip."""
        return context.scene is not None and context.scene.active_clip is not None

    def fill(self, context, layout):
        """Draw light, shadow catchers and look; the changes that a set-up would make; the buttons; and what was set up."""
        column, settings = columns(layout), context.scene.seeing_wind
        column.prop(settings, "hdri")
        if settings.hdri:
            column.prop(settings, "hdri_turn")
            column.prop(settings, "hdri_strength")
        for name in IN_SIGHT:
            column.prop(settings.composite, name)
        body = fold(column, "look", "Shutter, Aperture, Grain")
        for name in LOOK if body is not None else ():
            if name not in IN_SIGHT:
                body.prop(settings.composite, name)
        look = settings.composite
        changed = camera_changes(context.scene, look.fstop)
        changed += [words for *_, words in changes(context.scene, look.use_cycles, look.use_standard, samples_for(context.scene))]
        if changed:
            draw_text(layout, context, f"Set Up Composite changes: {', '.join(changed)}", "INFO")
        column = layout.column()
        column.operator("seeing_wind.set_up_composite", icon="NODE_COMPOSITING")
        column.operator("seeing_wind.render_composite", icon="RENDER_ANIMATION")
        column.operator("seeing_wind.render_composite", text="Render This Frame", icon="RENDER_STILL").still = True
        if settings.composite_said:
            draw_text(layout, context, settings.composite_said)


CLASSES = panels(CompositeTab, 21)

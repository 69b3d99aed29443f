"""The panel *Composite*."""

from ..job.panel_pieces import Tab, columns, panels


class CompositeTab(Tab):
    """The edit over the clip."""

    bl_label = "Composite"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """Once there is a clip."""
        return context.scene is not None and context.scene.active_clip is not None

    def fill(self, context, layout):
        """The light, set up, then render."""
        column, settings = columns(layout), context.scene.seeing_wind
        column.prop(settings, "hdri")
        if settings.hdri:
            column.prop(settings, "hdri_turn")
            column.prop(settings, "hdri_strength")
        column = layout.column()
        column.operator("seeing_wind.set_up_composite", icon="NODE_COMPOSITING")
        column.operator("seeing_wind.render_composite", icon="RENDER_ANIMATION")
        column.operator("seeing_wind.render_composite", text="Render This Frame", icon="RENDER_STILL").still = True


CLASSES = panels(CompositeTab, 21)

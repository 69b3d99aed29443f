"""The panel *Re-simulate*."""

from ...job.panel_pieces import Tab, draw_job, panels


class ResimulateTab(Tab):
    """Simulate the edit."""

    bl_label = "Re-simulate"
    step = "resimulate"

    def draw(self, context):
        """Go."""
        settings = context.scene.seeing_wind
        missing = "First recover a field" if not settings.recovered_take else "First insert a mesh" if not len(settings.bodies) else ""
        draw_job(self.layout, context, "resimulate", "seeing_wind.resimulate", "Re-simulate", "PHYSICS", missing)


CLASSES = panels(ResimulateTab, 4)

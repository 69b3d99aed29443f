"""The panel *Re-simulate*."""

from ...field.display import field_at_hand
from ...job.panel_pieces import Tab, draw_job, panels


class ResimulateTab(Tab):
    """Simulate the edit."""

    bl_label = "Re-simulate"
    step = "resimulate"

    def draw(self, context):
        """Go."""
        settings = context.scene.seeing_wind
        blown = settings.recovered_take or field_at_hand(context) is not None
        missing = "First recover a field, or add a wind" if not blown else "First insert a mesh" if not len(settings.bodies) else ""
        draw_job(self.layout, context, "resimulate", "seeing_wind.resimulate", "Re-simulate", "PHYSICS", missing)


CLASSES = panels(ResimulateTab, 4)

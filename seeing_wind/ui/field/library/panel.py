"""The panel *Wind Library*: winds that come with the extension, for a shot without a clip."""

from ...job.panel_pieces import Tab, panels
from . import shelf


class LibraryTab(Tab):
    """Winds to be added."""

    bl_label = "Wind Library"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """Whether this copy of the extension has any winds."""
        return context.scene is not None and bool(shelf.entries(shelf.SHELF))

    def fill(self, context, layout):
        """Draw a menu of all winds; the Asset Browser has images of them."""
        column = layout.column()
        column.operator_menu_enum("seeing_wind.add_wind", "wind", text="Add Wind", icon="FORCE_WIND")
        library = shelf.listed()
        if library is None:
            column.operator("seeing_wind.add_wind_library", icon="ASSET_MANAGER")
        else:
            column.label(text=f"In the Asset Browser: {library.name}", icon="ASSET_MANAGER")


CLASSES = panels(LibraryTab, 22)

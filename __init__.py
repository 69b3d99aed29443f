"""Hand-off to the extension's Blender side; Blender wants this file beside the manifest."""

from .seeing_wind.ui import register, unregister

__all__ = ["register", "unregister"]

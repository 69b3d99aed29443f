"""The engine itself: install it, and have it examined."""

import bpy

from .. import worker
from ..operator import JobOperator
from ..worker_command import ROOT, command, environment
from . import environment as engine_environment
from . import install
from .choices import EXTENSION

TEXT = "Seeing Wind Engine"


class InstallOperator(JobOperator):
    """Mix-in of both ways to install. (Of an operator that is registered Blender lets none be derived.)"""

    step = "engine"
    fetch_python = False

    def start(self, scene):
        """Only with the user's consent to go online, or from a folder of wheels."""
        return install.install(self.fetch_python)

    def finish(self, scene, result):
        """From now on it is found."""
        engine_environment.refresh()
        return "The engine is installed"


class SEEING_WIND_OT_install_engine(InstallOperator, bpy.types.Operator):
    """Make the engine's own Python environment and download its packages (CPU build: 400 MB); Blender's Python is not touched"""

    bl_idname = "seeing_wind.install_engine"
    bl_label = "Install Engine"


class SEEING_WIND_OT_fetch_python(InstallOperator, bpy.types.Operator):
    """Fetch a Python for the engine alone into the extension's folder (about 35 MB), then install the engine with it"""

    bl_idname = "seeing_wind.fetch_python"
    bl_label = "Fetch Python and Install Engine"
    fetch_python = True


class SEEING_WIND_OT_doctor(JobOperator, bpy.types.Operator):
    """Ask the engine what is installed, what works, and what to do about the rest"""

    bl_idname = "seeing_wind.doctor"
    bl_label = "Check Engine"
    step = "engine"

    def start(self, scene):
        """The engine examines itself."""
        engine_environment.refresh()
        call = command(engine_environment.engine_python(), "doctor")
        return worker.run(call, cwd=str(ROOT), env=environment())

    def finish(self, scene, result):
        """The findings as a text that the Text Editor shows; what the engine needs and has not is an error of its own."""
        checks = result.get("checks", [])
        further = [check for check in checks if check.get("optional")]
        rest = [check for check in checks if not check.get("optional")]
        lines = ["Needed:", *map(_line, rest), "", "Not needed, for further uses:", *map(_line, further)]
        text = bpy.data.texts.get(TEXT) or bpy.data.texts.new(TEXT)
        text.from_string("\n".join([f"Python: {engine_environment.engine_python()}", "", *lines, ""]))
        there = sum(check["ok"] for check in further)
        return f"The engine is complete, with {there or 'none'} of its {len(further)} optional parts. Text Editor: {TEXT}"


def _line(check: dict) -> str:
    mark = "ok      " if check["ok"] else "not here" if check.get("optional") else "missing "
    return f"  {mark}  {check['name']}: {check['detail']}  {check.get('advice', '')}".rstrip()


class SEEING_WIND_OT_open_preferences(bpy.types.Operator):
    """Open the preferences of this extension"""

    bl_idname = "seeing_wind.open_preferences"
    bl_label = "Open Preferences"

    def execute(self, context):
        """Blender's own way there."""
        return bpy.ops.preferences.addon_show(module=EXTENSION)


CLASSES = (SEEING_WIND_OT_install_engine, SEEING_WIND_OT_fetch_python, SEEING_WIND_OT_doctor, SEEING_WIND_OT_open_preferences)

"""Operators for the engine itself: install it, and check it."""

import bpy

from .. import worker
from ..operator import JobOperator
from ..worker_command import ROOT, command, environment
from . import environment as engine_environment
from . import install
from .choices import EXTENSION, outline_model

TEXT = "Seeing Wind Engine"


class InstallOperator(JobOperator):
    """Mix-in for both ways to install. (Blender does not allow a class derived from a registered operator.)"""

    step = "engine"
    fetch_python = False

    def start(self, scene):
        """Start the installation, which needs online access or a folder of wheels."""
        return install.install(self.fetch_python)

    def finish(self, scene, result):
        """Look for the engine again, which is found now."""
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
        """Run the engine's check of itself."""
        engine_environment.refresh()
        call = command(engine_environment.engine_python(), "doctor")
        return worker.run(call, cwd=str(ROOT), env=environment(outline_model=outline_model()))

    def finish(self, scene, result):
        """Write the findings into a text for the Text Editor. If a needed part is missing, the job fails instead."""
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
        """Open them with Blender's own operator."""
        return bpy.ops.preferences.addon_show(module=EXTENSION)


CLASSES = (SEEING_WIND_OT_install_engine, SEEING_WIND_OT_fetch_python, SEEING_WIND_OT_doctor, SEEING_WIND_OT_open_preferences)

"""The engine itself: install it, and ask it how it feels."""

import bpy

from ..job import worker as job
from ..job import worker_calls
from ..job.operator import JobOperator
from . import environment as engine_environment
from . import install as engine_install

TEXT = "Seeing Wind Doctor"


class SEEING_WIND_OT_install_engine(JobOperator, bpy.types.Operator):
    """Make the engine's own Python environment and download its packages (CPU build: 400 MB); Blender's Python is not touched"""

    bl_idname = "seeing_wind.install_engine"
    bl_label = "Install Engine"
    step = "engine"

    def start(self, scene):
        """Only with the user's consent to go online, or from a folder of wheels."""
        return engine_install.install()

    def finish(self, scene, result):
        """From now on it is found."""
        engine_environment.refresh()
        return "The engine is installed"


class SEEING_WIND_OT_fetch_python(SEEING_WIND_OT_install_engine):
    """Fetch a Python for the engine alone into the extension's folder (about 35 MB), then install the engine with it"""

    bl_idname = "seeing_wind.fetch_python"
    bl_label = "Fetch Python and Install Engine"

    def start(self, scene):
        """Only with the user's consent to go online."""
        return engine_install.install(fetch_python=True)


class SEEING_WIND_OT_doctor(JobOperator, bpy.types.Operator):
    """Ask the engine what is installed, what works, and what to do about the rest"""

    bl_idname = "seeing_wind.doctor"
    bl_label = "Doctor"
    step = "engine"

    def start(self, scene):
        """The engine examines itself."""
        engine_environment.refresh()
        call = worker_calls.command(engine_environment.engine_python(), "doctor")
        return job.run(call, cwd=str(worker_calls.ROOT), env=worker_calls.environment())

    def finish(self, scene, result):
        """The findings as a text that the Text Editor shows; what the engine needs and has not is an error of its own."""
        checks = result.get("checks", [])
        further = [check for check in checks if check.get("optional")]
        rest = [check for check in checks if not check.get("optional")]
        lines = ["Needed:", *map(_line, rest), "", "Not needed, for further uses:", *map(_line, further)]
        text = bpy.data.texts.get(TEXT) or bpy.data.texts.new(TEXT)
        text.from_string("\n".join([f"Python: {engine_environment.engine_python()}", "", *lines, ""]))
        there = sum(check["ok"] for check in further)
        return f"The engine is complete. Of {len(further)} optional parts {there} are there: see the text {TEXT}"


def _line(check: dict) -> str:
    mark = "ok      " if check["ok"] else "not here" if check.get("optional") else "missing "
    return f"  {mark}  {check['name']}: {check['detail']}  {check.get('advice', '')}".rstrip()


CLASSES = (SEEING_WIND_OT_install_engine, SEEING_WIND_OT_fetch_python, SEEING_WIND_OT_doctor)

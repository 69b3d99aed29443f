"""The base of operators that do their work at once, in Blender's process; `job/operator.py` is for those that start a worker."""

from __future__ import annotations

from ..engine.errors import SeeingWindError, UsageError
from .job import status, worker


class DirectOperator:
    """Mix-in for operators: runs `act`, which may raise SeeingWindError, and reports the result."""

    bl_options = {"REGISTER", "UNDO"}

    def act(self, context) -> str:
        """Do the work; returns the message for the user."""
        raise NotImplementedError

    def execute(self, context):
        """Run `act`, then bring the panel up to date."""
        try:
            if context.scene.library is not None:
                raise UsageError(*status.LINKED)
            said = self.act(context)
        except (SeeingWindError, OSError) as error:
            self.report({"ERROR"}, " ".join(worker.told(error)[:2]).strip())
            return {"CANCELLED"}
        status.refresh(context.scene)
        self.report({"INFO"}, said)
        return {"FINISHED"}

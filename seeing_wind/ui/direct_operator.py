"""Operators that do their work at once, in Blender's own process; `job/operator.py` has those that start a worker."""

from __future__ import annotations

from ..engine.errors import SeeingWindError, UsageError
from .job import status, worker


class DirectOperator:
    """Mix-in: a function that may raise SeeingWindError, run and reported."""

    bl_options = {"REGISTER", "UNDO"}

    def act(self, context) -> str:
        """Do it; returns what to tell the user."""
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

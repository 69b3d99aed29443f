"""Ask a vision-language model what is in the clip's first frame and what it is made of. The answers are shown; the user chooses."""

import ipaddress
from urllib.parse import urlsplit

import bpy
from bpy.props import StringProperty

from ....engine.errors import UsageError
from ....engine.settings import ObserveSettings, words_of
from ...direct_operator import DirectOperator
from ...job import takes, worker
from ...job.install.choices import asked_model
from ...job.install.environment import NoOnlineAccess, engine_python
from ...job.operator import JobOperator
from ...job.worker_command import ROOT, command, environment
from ...option_properties import values_of
from ..options import clip_options
from .properties import NUMBERS


class NoModel(UsageError):
    """No model is configured."""

    mend = "open_preferences"


class SEEING_WIND_OT_identify(JobOperator, bpy.types.Operator):
    """Ask a vision-language model what is in the clip's first frame, where, and what it is made of; nothing is changed by its answer"""

    bl_idname = "seeing_wind.identify"
    bl_label = "Ask What Is in the Clip"
    bl_options = {"UNDO"}
    step = "identify"

    endpoint: StringProperty(name="Address", options={"SKIP_SAVE"}, description="Of an OpenAI-compatible server; empty: the preferences'")
    model: StringProperty(name="Model", options={"SKIP_SAVE"}, description="The server's name of the model; empty: the preferences'")

    def start(self, scene):
        """Start the worker. The key is passed to it in its environment only."""
        address, model, key = asked_model()
        # the key in the preferences must go only to the server in the preferences
        key = "" if self.endpoint and self.endpoint != address else key
        address, model = self.endpoint or address, self.model or model
        if not address or not model:
            raise NoModel("No model is named that could be asked.", "Give the address of a server and its model in the preferences.")
        if not is_here(address) and not bpy.app.online_access:
            raise NoOnlineAccess(
                f"{address} is on the network, and Blender may not use it.", "Allow Online Access in Preferences > System > Network."
            )
        settings = scene.seeing_wind
        clip, seen, _ = clip_options(settings, values_of(settings, ObserveSettings))
        call = command(
            engine_python(), "identify", clip, *words_of(ObserveSettings(frames=seen["frames"])),
            "--take", str(takes.take_folder(settings)), "--material-endpoint", address, "--material-model", model,
        )  # fmt: skip
        return worker.run(call, cwd=str(ROOT), env=environment(key))

    def finish(self, scene, result):
        """List the answers, for the user to choose from."""
        settings = scene.seeing_wind
        settings.guesses.clear()
        settings.active_guess = 0
        for each in result.get("objects", []):
            guess = settings.guesses.add()
            guess.name, guess.made_of = each["name"], each["material"]
            guess.mask, guess.law = each["mask"], each["law"].upper()
            for name in NUMBERS:
                setattr(guess, name, each[name] or 0.0)
        names = ", ".join(guess.name for guess in settings.guesses)
        return f"Found {names}" if names else "Nothing was found that could move"


class SEEING_WIND_OT_use_guess(DirectOperator, bpy.types.Operator):
    """Take the chosen thing as the object: its outline, and the numbers of its material, which can be changed below"""

    bl_idname = "seeing_wind.use_guess"
    bl_label = "Use as Object"

    thing: StringProperty(name="Thing", options={"SKIP_SAVE"}, description="Of one of the things that were found; empty: the active one")

    def act(self, context):
        """Copy mask, law and numbers of the answer to the scene's settings."""
        settings = context.scene.seeing_wind
        guess = settings.guesses.get(self.thing) if self.thing else None
        if guess is None and not self.thing and settings.active_guess < len(settings.guesses):
            guess = settings.guesses[settings.active_guess]
        if guess is None:
            said = f"There is no {self.thing!r} among what was found." if self.thing else "Nothing was found."
            raise UsageError(said, "Ask the model first.")
        settings.object_mode, settings.mask, settings.law = "MASK", guess.mask, guess.law
        for name in NUMBERS:
            given = getattr(guess, name) > 0.0 or name == "poisson_ratio"
            setattr(settings, f"use_{name}", given)
            if given:
                setattr(settings, name, getattr(guess, name))
        return f"The object is the {guess.name}, of {guess.made_of}"


def is_here(address: str) -> bool:
    """Whether an address is on this machine, so that a request does not use the network."""
    try:
        host = urlsplit(address).hostname or ""
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


CLASSES = (SEEING_WIND_OT_identify, SEEING_WIND_OT_use_guess)

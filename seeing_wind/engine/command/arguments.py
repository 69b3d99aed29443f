"""The command line: the verbs and options that users, batch scripts and the panel rely on.

Options that are settings are defined once, in `engine/settings`; here are the verbs and the options that only the command line has.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
from collections.abc import Collection
from typing import Any, NoReturn

from .. import __version__
from ..conventions import NO_GRAVITY
from ..errors import UsageError
from ..settings import BuildSettings, Edit, ObserveSettings, Option, RecoverSettings, ReportSettings, WindSettings, options_of
from ..settings.build import MADE, may_be_sheet, part_materials
from ..settings.observe import NETWORKS, NO_NETWORK, SEEN, VIEW, installed_network
from ..settings.recover import SOLVE

DESCRIPTIONS = {NETWORKS: "each a folder, or a name in the hub's cache; see `doctor`"}
"""Descriptions of the option groups that need more than their title."""
OWN_WORDS = (
    (r"^argument (\S+): not allowed with argument (\S+)$", r"\1 is not allowed with \2"),
    (r"^argument (\S+): expected (one|at least one) argument$", r"\1 needs a value"),
    (r"^argument (\S+): expected (\d+) arguments$", r"\1 needs \2 values"),
    (r"^unrecognized arguments:", "unknown options:"),
    (r"^the following arguments are required:", "missing:"),
    (r"^argument ", ""),
)
"""Patterns of argparse's messages, and what they are replaced by: a file of jobs has no arguments."""
CLIP = "a video, or with --fps a folder of images or a pattern such as shot_%%04d.png"


class Parser(argparse.ArgumentParser):
    """A parser that raises `UsageError` for wrong usage, where argparse would print to stderr and exit from the middle of a worker.

    Options are listed under the titles of their groups; of the options that share `one_of`, at most one may be given.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # argparse mistakes -4.4e-07, a component of a rotated gravity, for an option: its own pattern has no exponents.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self._titled: dict[str, Any] = {}
        self._alternatives: dict[str, Any] = {}

    def error(self, message: str) -> NoReturn:
        for pattern, words in OWN_WORDS:
            message = re.sub(pattern, words, message)
        raise UsageError(f"{message[:1].upper()}{message[1:]}.", f"See `{self.prog} --help`.")

    def titled(self, title: str, description: str | None = None) -> Any:
        """The option group with that title, created at the first call."""
        if title not in self._titled:
            self._titled[title] = self.add_argument_group(title, description or DESCRIPTIONS.get(title))
        return self._titled[title]

    def one_of(self, name: str, title: str) -> Any:
        """The set `name` of mutually exclusive options under that title, created at the first call."""
        if name not in self._alternatives:
            self._alternatives[name] = self.titled(title).add_mutually_exclusive_group()
        return self._alternatives[name]

    def add_settings(self, cls: type, only: Collection[str] = (), but: Collection[str] = (), **defaults: tuple[Any, str]) -> None:
        """Add those options of a settings dataclass that the parser does not have yet.

        Args:
            cls: a class of `engine.settings`.
            only: names of the options to add; all if empty.
            but: names of options to leave out.
            defaults: by name, a default in place of the class's own, and the words for it in the help.
        """
        for one in options_of(cls).values():
            if one.name in (only or {one.name}) and one.name not in but and one.flag not in self._option_string_actions:
                home = self.one_of(one.one_of, one.group) if one.one_of else self.titled(one.group) if one.group else self
                default, said = defaults.get(one.name, (one.default, ""))
                home.add_argument(one.flag, **_keywords(one), default=default, help=one.summary(default, said).replace("%", "%%"))


def _keywords(one: Option) -> dict[str, Any]:
    words: dict[str, Any] = {"type": one.read, "metavar": one.metavar or (f"{{{','.join(one.choices)}}}" if one.choices else None)}
    if one.form is not None:
        return words | ({"nargs": "+"} if one.form.many else {})
    return words | ({} if one.count is None else {"nargs": one.count or "+"})


def path(text: str) -> str:
    """Read a path, which must not be blank: a blank one would mean the current folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError(f"'{text}' is not a path")
    return text


def parser() -> Parser:
    """The whole command line."""
    root = Parser(prog="seeing_wind.engine", description="Recover the force field that moved something in a clip.", allow_abbrev=False)
    root.add_argument("--version", action="version", version=f"Seeing Wind {__version__}", help="the version")
    verbs = root.add_subparsers(dest="verb", required=True, parser_class=Parser, metavar="VERB")
    _recover(verbs.add_parser("observe", help="draw and judge what is seen in a clip; `recover` goes on from it", allow_abbrev=False))
    _recover(verbs.add_parser("recover", help="a clip becomes a force field", allow_abbrev=False))
    _recover_trajectories(verbs.add_parser("recover-trajectories", help="3D trajectories become a force field", allow_abbrev=False))
    sample = verbs.add_parser("sample", help="the force density at given points", allow_abbrev=False)
    sample.add_argument("take", type=path, metavar="DIR", help="take of the recovered field")
    sample.add_argument("--points", required=True, metavar="P.npy", help="(N,3) m for one frame, or (T,N,3) m, one row per frame")
    sample.add_argument("--frame", type=int, metavar="T", help="the frame for (N,3) points")
    sample.add_argument("--out", required=True, metavar="OUT.npz", help="gets force_density [N/m³], confidence and distance [m]")
    sample.add_settings(Edit, only={"fade"})
    resimulate = verbs.add_parser("resimulate", help="insert, pin, scale and simulate in the recovered field", allow_abbrev=False)
    resimulate.add_argument("source", type=path, metavar="DIR", help="take of the recovered field")
    resimulate.add_argument("--edit", required=True, metavar="EDIT.toml", help="bodies and colliders, see below")
    resimulate.add_argument("--take", type=path, required=True, metavar="OUT", help="gets bodies/NAME.npz: vertices (T+1,V,3) m, fps")
    export = verbs.add_parser("export", help="the field on a lattice, for other programs", allow_abbrev=False)
    export.add_argument("take", type=path, metavar="DIR", help="take of the recovered field")
    export.add_argument("--format", required=True, choices=("vdb", "fga", "ply", "npz"), help="vdb only inside Blender")
    export.add_argument("--out", type=path, required=True, metavar="PATH", help="the file (npz) or the folder (ply, fga) to write")
    export.add_settings(Edit, only={"fade"})
    joined = verbs.add_parser("join", help="one wind for the objects of several takes of a clip", allow_abbrev=False)
    joined.add_argument("takes", type=path, nargs="+", metavar="DIR", help="takes of two objects or more; each gets the wind of all")
    _identify(verbs.add_parser("identify", help="ask a vision-language model what is in the first frame", allow_abbrev=False))
    _batch(verbs.add_parser("batch", help="many clips and edits, here or on a farm", allow_abbrev=False))
    verbs.add_parser("doctor", help="what is installed, what works, what to do about the rest", allow_abbrev=False)
    return root


def _recover(p: Parser) -> None:
    p.add_argument("clip", metavar="CLIP", help=CLIP)
    p.add_argument("--take", type=path, required=True, metavar="DIR", help="folder of the results; made if need be")
    p.add_settings(ObserveSettings, only={"fps", "frames", "mask", "box", "points"})
    p.one_of("object", SEEN).add_argument(
        "--objects", metavar="JSON", help="objects.json of `identify`: each object by its mask and material, in a take of its own"
    )
    p.add_settings(ObserveSettings, but={"seed"})
    p.titled(SEEN).add_argument(
        "--view", nargs=3, action="append", default=[], metavar=("CLIP2", "CAMERA2.json", "MASK2.png"), help=f"{VIEW}; may be repeated"
    )
    p.add_settings(BuildSettings, but={"seed"})
    asked = p.titled("asking what it is made of", "a vision-language model; --material is used if it fails")
    asked.add_argument("--material-endpoint", metavar="URL", help="OpenAI-compatible address, such as http://localhost:11434/v1")
    asked.add_argument("--material-model", metavar="NAME", help="the endpoint's name of the model")
    _solve(p)


def _recover_trajectories(p: Parser) -> None:
    p.add_argument(
        "truth",
        metavar="TRUTH.npz",
        help="x (T+1,N,3) m, fps, E Pa or a material's name; optional rho kg/m³, nu, fixed (N,) bool, gravity (3,) m/s², yield_stress Pa, "
        "visible (T+1,N) bool, all true in frame 0, and the errors of x, measured if not given: sigma m, or covariance (3,3) or (N,3,3) "
        "m²; with faces (F,3), areal_density kg/m², thickness m and optional damping, the loss factor, the points are the vertices of a "
        "shell",
    )
    p.add_argument("--take", type=path, required=True, metavar="DIR", help="folder of the results; made if need be")
    made = [one.name for one in options_of(BuildSettings).values() if one.group == MADE]
    p.add_settings(BuildSettings, only=made, material=(None, "the file's numbers"))
    _solve(p, gravity=(None, "the file's, or none"))


def _solve(p: Parser, **defaults: tuple[Any, str]) -> None:
    p.add_settings(RecoverSettings, only={"gravity"}, **defaults)
    p.one_of("gravity", SOLVE).add_argument(
        "--no-gravity", dest="gravity", action="store_const", const=NO_GRAVITY, help="gravity counts as part of the field"
    )
    p.add_settings(RecoverSettings)
    p.add_settings(WindSettings)
    p.add_settings(ReportSettings)


def _identify(p: Parser) -> None:
    p.add_argument("clip", metavar="CLIP", help="a video, a folder of images, or a pattern such as shot_%%04d.png")
    p.add_argument("--take", type=path, required=True, metavar="DIR", help="gets objects.json and a mask per object")
    p.add_argument("--material-endpoint", required=True, metavar="URL", help="OpenAI-compatible address")
    p.add_argument("--material-model", required=True, metavar="NAME", help="the endpoint's name of the model")
    p.add_settings(ObserveSettings, only={"frames", "detector_model", "mask_model"})


def _batch(p: Parser) -> None:
    p.add_argument("jobs", type=path, metavar="JOBS.toml", help="see docs/guide/batch-and-farm.md; what is done already is not done again")
    p.add_argument("--again", action="store_true", help="go through all jobs; finished stages of a take are still kept")
    where = p.add_mutually_exclusive_group()
    where.add_argument("--ray", metavar="ADDRESS", help="run on this Ray cluster, HOST:PORT of its head, or auto; needs the extra `farm`")
    where.add_argument("--openjd", type=path, metavar="FOLDER", help="run nothing; write an Open Job Description bundle for a farm")
    where.add_argument("--check", action="store_true", help="run nothing; check the jobs and the files that they name")
    p.add_argument("--shared", action="store_true", help="with --ray: every node sees the files under the same paths; nothing is shipped")
    attempts = "with --ray: how often a job is started at most, if its node dies (default: 3)"
    number = Option("", flag="--attempts", kind=int, minimum=1, maximum=100)
    p.add_argument("--attempts", type=number.read, metavar="N", help=attempts)


def settings_of(cls: type, arguments: argparse.Namespace, **more: Any) -> Any:
    """The dataclass `cls`, filled from the parsed options of the same names; values in `more` take precedence."""
    values: dict[str, Any] = {}
    options = options_of(cls)
    for field in dataclasses.fields(cls):
        value = more.get(field.name, getattr(arguments, field.name, None))
        if value is not None:
            form = options[field.name].form if field.name in options else None
            if form is not None and form.many:
                value = [part for word in value for part in word]
            values[field.name] = tuple(value) if isinstance(value, list) else value
    return cls(**values)


def observe_settings(arguments: argparse.Namespace) -> ObserveSettings:
    """The settings of the stage *observe*. Points are recognised if the body may be a sheet, or if its material is yet to be asked for. The
    network that is installed helps to outline the object, unless another one or none is named.

    Raises:
        MaterialError: an unknown material, or numbers that are not physical.
    """
    building = settings_of(BuildSettings, arguments)
    part_materials(building)  # refused now, not once the clip was read
    sheet = may_be_sheet(building)
    unknown = getattr(arguments, "material_endpoint", None) is not None
    settings = settings_of(ObserveSettings, arguments, recognise=sheet or unknown)
    if settings.outline_model is None and settings.mask_model is None:
        return dataclasses.replace(settings, outline_model=installed_network())
    return dataclasses.replace(settings, outline_model=None) if (settings.outline_model or "").strip().lower() == NO_NETWORK else settings


def properties_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Properties of the material from the options, as arguments of `materials.adjust`; None for those that were not given."""
    return {one.name: getattr(arguments, one.name) for one in options_of(BuildSettings).values() if one.group == MADE and one.optional}

"""The command line: the verbs and options that users, batch scripts and the panel hold on to."""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
from collections.abc import Callable
from typing import Any, NoReturn

from ..conventions import GRAVITY
from ..errors import UsageError
from ..settings import (
    FIELDS,
    FLOWING_PARTICLES,
    PARTICLES,
    REPORTS,
    BuildSettings,
    ObserveSettings,
    RecoverSettings,
    ReportSettings,
    WindSettings,
)

LAWS = ("neo_hookean", "corotated", "von_mises", "viscoplastic")
DEVICES = ("auto", "cpu", "cuda")


class Parser(argparse.ArgumentParser):
    """Wrong usage is an error message like any other, not text on stderr and an exit from the middle of a worker."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # argparse takes -4.4e-07, a component of a turned gravity, for an option: its own pattern knows no exponents.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{self.prog}: {message}.", f"See `{self.prog} --help`.")


def frame_range(text: str) -> tuple[int, int]:
    """'A:B' -> (A, B), both inclusive."""
    try:
        first, last = (int(part) for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a frame range such as 12:27") from None
    if first < 0 or last <= first:
        raise argparse.ArgumentTypeError(f"'{text}' holds no two pictures in order, such as 12:27")
    return first, last


def finite(text: str) -> float:
    """A number that is neither infinite nor NaN."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not finite")
    return value


def positive(text: str) -> float:
    """A finite number above zero."""
    value = finite(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' must be above zero")
    return value


def whole(least: int, most: int) -> Callable[[str], int]:
    """A parser of whole numbers from `least` to `most`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number") from None
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"'{text}' must lie between {least} and {most}")
        return value

    return parse


def path(text: str) -> str:
    """A path that is not blank: that would be the current folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError(f"'{text}' is no path")
    return text


def device(text: str) -> str:
    """The solver's device.

    Raises:
        UsageError: for cuda, which stays a word of the command line so that scripts that ask for it are told.
    """
    if text == "cuda":
        raise UsageError("The solver runs on the CPU and has no kernels for CUDA.", "Leave --device out, or choose auto or cpu.")
    return text


def pixel(text: str) -> tuple[float, float]:
    """'X,Y' -> (X, Y)."""
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"'{text}' is not a point such as 120,80")
    return finite(parts[0]), finite(parts[1])


def fov(text: str) -> float:
    """Degrees strictly between 0 and 180."""
    value = positive(text)
    if value >= 180.0:
        raise argparse.ArgumentTypeError(f"'{text}' must be under 180 degrees")
    return value


def parser() -> Parser:
    """The whole command line."""
    root = Parser(prog="seeing_wind.engine", description="Recover the force field that moved something in a clip.", allow_abbrev=False)
    verbs = root.add_subparsers(dest="verb", required=True, parser_class=Parser, metavar="VERB")
    _recover(verbs.add_parser("preview", help="what is seen in a clip, drawn and judged; `recover` goes on from it", allow_abbrev=False))
    _recover(verbs.add_parser("recover", help="a clip becomes a force field", allow_abbrev=False))
    _recover_trajectories(verbs.add_parser("recover-trajectories", help="3D trajectories become a force field", allow_abbrev=False))
    sample = verbs.add_parser("sample", help="the force density at given points", allow_abbrev=False)
    sample.add_argument("take", type=path, metavar="DIR")
    sample.add_argument("--points", required=True, metavar="P.npy", help="(N,3) m for one frame, or (T,N,3) m, one row per frame")
    sample.add_argument("--frame", type=int, metavar="T", help="the frame for (N,3) points")
    sample.add_argument("--out", required=True, metavar="OUT.npz")
    resimulate = verbs.add_parser("resimulate", help="insert, pin, scale and simulate in the recovered field", allow_abbrev=False)
    resimulate.add_argument("source", type=path, metavar="DIR")
    resimulate.add_argument("--edit", required=True, metavar="EDIT.toml")
    resimulate.add_argument("--take", type=path, required=True, metavar="OUT")
    resimulate.add_argument("--device", type=device, choices=DEVICES, default="auto", help="auto is the CPU")
    export = verbs.add_parser("export", help="the field for other programs", allow_abbrev=False)
    export.add_argument("take", type=path, metavar="DIR")
    export.add_argument("--format", required=True, choices=("vdb", "fga", "ply", "npz"))
    export.add_argument("--out", type=path, required=True, metavar="PATH")
    identify = verbs.add_parser("identify", help="ask a vision-language model what is in the first picture", allow_abbrev=False)
    identify.add_argument("clip", metavar="CLIP")
    identify.add_argument("--take", type=path, required=True, metavar="DIR", help="gets objects.json and a mask per object")
    identify.add_argument("--frames", type=frame_range, metavar="A:B", help="first and last picture, both inclusive, counted from 0")
    identify.add_argument("--material-endpoint", required=True, metavar="URL")
    identify.add_argument("--material-model", required=True, metavar="NAME")
    identify.add_argument("--detector-model", metavar="MODEL", help="finds each object by its name: Grounding DINO")
    identify.add_argument("--mask-model", metavar="MODEL", help="cuts each object out: SAM 2")
    _batch(verbs.add_parser("batch", help="many clips and edits, here or on a farm", allow_abbrev=False))
    verbs.add_parser("doctor", help="what is installed, what works, what to do about the rest", allow_abbrev=False)
    return root


def _recover(p: Parser) -> None:
    p.add_argument("clip", metavar="CLIP")
    p.add_argument("--take", type=path, required=True, metavar="DIR", help="folder of the results; made if need be")
    seen = p.add_argument_group("what is seen")
    seen.add_argument("--fps", type=positive, metavar="F", help="frames per second, if the file's number is wrong")
    seen.add_argument("--frames", type=frame_range, metavar="A:B", help="first and last picture, both inclusive, counted from 0")
    which = seen.add_mutually_exclusive_group()
    which.add_argument("--mask", metavar="PNG", help="non-zero = the object, in the first picture")
    which.add_argument("--box", type=finite, nargs=4, metavar=("X0", "Y0", "X1", "Y1"), help="pixels round the object, first picture")
    which.add_argument("--points", type=pixel, nargs="+", metavar="X,Y", help="points on the object, in pixels of the first picture")
    which.add_argument("--objects", metavar="JSON", help="objects.json of `identify`: each object by its mask and material, each in a take")
    seen.add_argument("--tracks", metavar="NPZ", help="xy (T+1,K,2) px and visible (T+1,K), instead of tracking")
    scale = seen.add_mutually_exclusive_group()
    scale.add_argument("--depth", metavar="NPY", help="(H,W) metres along the view axis, first picture")
    scale.add_argument("--distance", type=positive, metavar="M", help="metres from the camera to the object")
    scale.add_argument("--pixels-per-metre", type=positive, metavar="P", help="image scale in the object's plane")
    view = seen.add_mutually_exclusive_group()
    view.add_argument("--camera", metavar="JSON", help="width height fx fy cx cy camera_to_world [k1 k2 p1 p2 k3], or transforms.json")
    view.add_argument("--fov", type=fov, default=ObserveSettings.fov, metavar="DEG", help="horizontal field of view [degrees]")
    seen.add_argument("--pin", metavar="PNG", help="non-zero = held in place, in the first picture")
    seen.add_argument(
        "--view", nargs=3, action="append", default=[], metavar=("CLIP2", "CAMERA2.json", "MASK2.png"), help="a further synchronised view"
    )
    networks = p.add_argument_group("networks instead of the defaults", "each a folder, or a name in the hub's cache; see `doctor`")
    networks.add_argument("--depth-model", metavar="MODEL", help="metric depth: Depth Anything V2, Depth Pro, UniDepth")
    networks.add_argument("--prompt", metavar="TEXT", help="what the object is, in words, for --detector-model")
    networks.add_argument("--detector-model", metavar="MODEL", help="a box from words: Grounding DINO")
    networks.add_argument("--mask-model", metavar="MODEL", help="the object's outline, followed through the clip: SAM 2")
    networks.add_argument("--track-model", metavar="MODEL", help="point tracks: CoTracker 3")
    _gravity(p)
    _material(p, default=BuildSettings.material)
    asked = p.add_argument_group("who is asked what it is made of", "a vision-language model; --material is what stays if it fails")
    asked.add_argument("--material-endpoint", metavar="URL", help="OpenAI-compatible address, such as http://localhost:11434/v1")
    asked.add_argument("--material-model", metavar="NAME", help="the endpoint's name of the model")
    p.add_argument("--thickness", type=positive, metavar="M", help="metres of body behind the visible surface; else seen or guessed")
    p.add_argument(
        "--particles",
        type=whole(8, 100_000),
        default=BuildSettings.particles,
        metavar="N",
        help=f"about how many particles stand for the body; else {PARTICLES}, or {FLOWING_PARTICLES} where the material flows",
    )
    _solve(p)


def _recover_trajectories(p: Parser) -> None:
    p.add_argument(
        "truth",
        metavar="TRUTH.npz",
        help="x (T+1,N,3) m, fps, E Pa or a material's name; optional rho kg/m³, nu, fixed (N,) bool, gravity (3,) m/s², yield_stress Pa, "
        "visible (T+1,N) bool, all true in picture 0, and the errors of x, else measured: sigma m, or covariance (3,3) or (N,3,3) m²",
    )
    p.add_argument("--take", type=path, required=True, metavar="DIR")
    _gravity(p, "the file's, or none")
    _material(p, default=None)
    _solve(p)


def _batch(p: Parser) -> None:
    p.add_argument("jobs", type=path, metavar="JOBS.toml", help="see docs/batch.md; what is done already is not done again")
    p.add_argument("--again", action="store_true", help="go through all jobs; finished stages of a take are still kept")
    where = p.add_mutually_exclusive_group()
    where.add_argument("--ray", metavar="ADDRESS", help="run on this Ray cluster, HOST:PORT of its head, or auto; needs the extra `farm`")
    where.add_argument("--openjd", type=path, metavar="FOLDER", help="run nothing; write an Open Job Description bundle for a farm")
    p.add_argument("--shared", action="store_true", help="with --ray: every node sees the files under the same paths; nothing is shipped")
    p.add_argument("--attempts", type=whole(1, 100), metavar="N", help="with --ray: starts of one job at most, if its node dies; default 3")


def _gravity(p: Parser, default: str = str(GRAVITY)) -> None:
    which = p.add_mutually_exclusive_group()
    which.add_argument("--gravity", type=finite, nargs=3, metavar=("GX", "GY", "GZ"), help=f"known acceleration [m/s²], default {default}")
    which.add_argument("--no-gravity", action="store_true", help="gravity counts as part of the field")


def _material(p: Parser, default: str | None) -> None:
    group = p.add_argument_group("what it is made of")
    group.add_argument("--material", default=default, metavar="NAME", help="a preset of the material library")
    group.add_argument("--law", choices=LAWS)
    group.add_argument("--density", type=positive, metavar="R", help="kg/m³")
    group.add_argument("--youngs-modulus", type=positive, metavar="E", help="Pa")
    group.add_argument("--poisson-ratio", type=finite, metavar="NU")
    group.add_argument("--yield-stress", type=positive, metavar="Y", help="Pa")
    group.add_argument("--viscosity", type=positive, metavar="ETA", help="Pa s")


def _solve(p: Parser) -> None:
    group = p.add_argument_group("the solve")
    group.add_argument("--representation", choices=("causal_triplane", "kplanes", "point"), default="causal_triplane")
    group.add_argument(
        "--objective",
        choices=("tracking", "image", "flow_depth"),
        default="tracking",
        help="what the force must explain; the others need --schedule paper",
    )
    group.add_argument(
        "--schedule", choices=("default", "paper"), default="default", help="paper: gradient descent frame by frame, for comparison"
    )
    group.add_argument(
        "--frame-iterations",
        type=whole(1, 10_000),
        default=RecoverSettings.frame_iterations,
        metavar="N",
        help="iterations per frame at most, with --schedule paper",
    )
    group.add_argument(
        "--refine",
        type=whole(0, 10_000),
        default=RecoverSettings.refine,
        metavar="N",
        help="refine the stored field through the simulator, in N steps at most: its own simulation then strays less (default: off)",
    )
    group.add_argument(
        "--stiffness",
        choices=("free", "given"),
        default=RecoverSettings.stiffness,
        help="free: that of a held elastic body is found with the force, where the motion tells it; given: the material's",
    )
    group.add_argument(
        "--field",
        choices=FIELDS,
        default=WindSettings.field,
        help="force: a body force in N/m3; wind: a velocity of the air in m/s, by a drag law; auto: what is more probable "
        "(default: %(default)s)",
    )
    group.add_argument("--device", type=device, choices=DEVICES, default="auto", help="auto is the CPU")
    group.add_argument(
        "--iterations",
        type=whole(1, 1000),
        default=RecoverSettings.iterations,
        metavar="N",
        help="Gauss-Newton iterations at most (default: %(default)s); 1 gives a draft",
    )
    group.add_argument("--seed", type=whole(0, 2**31 - 1), default=0, metavar="N")
    p.add_argument(
        "--report",
        choices=REPORTS,
        default=ReportSettings.report,
        help="what is drawn of a recovery: nothing; figures and overlay; the re-simulated clip, too (default: %(default)s)",
    )


def settings_of(cls: type, arguments: argparse.Namespace, **more: Any) -> Any:
    """The dataclass `cls` filled from the parsed options of the same names, `more` winning."""
    values: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        value = more.get(field.name, getattr(arguments, field.name, None))
        if value is not None:
            values[field.name] = tuple(value) if isinstance(value, list) else value
    return cls(**values)


def properties_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """What the options say of the material, as `materials.adjusted` takes it; None where they do not."""
    names = ("law", "density", "youngs_modulus", "poisson_ratio", "yield_stress", "viscosity")
    return {name: getattr(arguments, name) for name in names}


def gravity_of(arguments: argparse.Namespace, default: tuple[float, float, float] = GRAVITY) -> tuple[float, float, float]:
    """The known acceleration that the options ask for [m/s²]."""
    if arguments.no_gravity:
        return (0.0, 0.0, 0.0)
    return tuple(arguments.gravity) if arguments.gravity else default

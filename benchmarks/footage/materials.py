"""Scores a provider of materials by the paper's Table 4: type F1, error of the density, error of Young's modulus.

    python benchmarks/footage/materials.py [FOLDER] --endpoint URL --model NAME [--out ANSWERS.json]     ask a vision-language model
    python benchmarks/footage/materials.py [FOLDER] --answers ANSWERS.json                               score answers made elsewhere

FOLDER (default: benchmarks/footage/everyday_objects) holds truth.toml, a list of [[object]] tables with frame, type, density [kg/m³] and
youngs_modulus [Pa]. ANSWERS.json maps a frame's name to {"type", "density", "youngs_modulus"}; a missing one counts as a wrong type and
is left out of the two errors, whose lines then say how many they rest on.

rho MAPE: mean of |rho - truth| / truth. E log-MAPE: mean of |log10 E - log10 truth| / log10 truth, E in Pa. The paper defines neither.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tomllib
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from seeing_wind.engine.errors import ModelError, SeeingWindError, UsageError  # noqa: E402
from seeing_wind.engine.observe.models.endpoint import endpoint_of  # noqa: E402
from seeing_wind.engine.observe.models.language import TYPES, estimate  # noqa: E402
from seeing_wind.engine.progress import NoProgress  # noqa: E402

HERE = Path(__file__).resolve().parent / "everyday_objects"

Answer = dict[str, Any]


def read_truth(folder: Path) -> list[Answer]:
    """The objects of `folder`/truth.toml.

    Raises:
        UsageError: no such file, or an object without what is scored.
    """
    try:
        objects = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))["object"]
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(f"{folder} has no usable truth.toml ({error}).", "It needs [[object]] tables.") from error
    for one in objects:
        if one.get("type") not in TYPES or not all(one.get(key, 0) > 0 for key in ("density", "youngs_modulus")):
            raise UsageError(f"An object of {folder}/truth.toml lacks type, density or youngs_modulus.", f"Types: {', '.join(TYPES)}.")
        if not (folder / one.get("picture", "")).is_file():
            raise UsageError(f"There is no frame {one.get('picture')} in {folder}.", "Render it, or mend truth.toml.")
    return objects


def ask_all(folder: Path, objects: list[Answer], url: str, model: str) -> dict[str, Answer]:
    """Every frame's answer by the endpoint; frames that it fails on are told and left out."""
    endpoint, answers = endpoint_of(url, model), {}
    for one in objects:
        image = cv2.cvtColor(cv2.imread(str(folder / one["picture"])), cv2.COLOR_BGR2RGB)
        try:
            found = estimate(endpoint, image, np.ones(image.shape[:2], bool), NoProgress())
        except ModelError as error:
            print(f"{one['picture']}: {error}", file=sys.stderr)
            continue
        answers[one["picture"]] = {"type": found.type, "density": found.density, "youngs_modulus": found.youngs_modulus}
    return answers


def score(objects: list[Answer], answers: dict[str, Answer]) -> list[dict[str, Any]]:
    """One row per type and one overall: samples, f1, answered, density_mape [%], log_mape [%] (NaN where nothing was answered)."""
    pairs = [(one, answers.get(one["picture"])) for one in objects]
    rows = []
    for kind in TYPES:
        hits = sum(one["type"] == kind and found is not None and found["type"] == kind for one, found in pairs)
        claimed = sum(found is not None and found["type"] == kind for _, found in pairs)
        there = sum(one["type"] == kind for one, _ in pairs)
        f1 = 2.0 * hits / (claimed + there) if claimed + there else math.nan
        rows.append({"type": kind, "f1": f1, **_errors([pair for pair in pairs if pair[0]["type"] == kind])})
    shown = [row["f1"] for row in rows if row["samples"]]
    rows.append({"type": "overall", "f1": sum(shown) / len(shown), **_errors(pairs)})
    return rows


def _errors(pairs: list[tuple[Answer, Answer | None]]) -> dict[str, Any]:
    known = [(one, found) for one, found in pairs if found is not None]
    density = [abs(found["density"] - one["density"]) / one["density"] for one, found in known]
    stiff = [
        abs(math.log10(found["youngs_modulus"]) - math.log10(one["youngs_modulus"])) / math.log10(one["youngs_modulus"])
        for one, found in known
    ]
    mean = [100.0 * sum(values) / len(values) if values else math.nan for values in (density, stiff)]
    return {"samples": len(pairs), "answered": len(known), "density_mape": mean[0], "log_mape": mean[1]}


def read_answers(path: str) -> dict[str, Answer]:
    """Answers made elsewhere.

    Raises:
        UsageError: not such a file.
    """
    try:
        answers = json.loads(Path(path).read_text(encoding="utf-8"))
        for found in answers.values():
            if not (float(found["density"]) > 0 and float(found["youngs_modulus"]) > 0 and isinstance(found["type"], str)):
                raise ValueError(f"{found} is not physical")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"The answers {path} cannot be used ({error}).", "Map frames to type, density, youngs_modulus.") from error
    return answers


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as text."""
    lines = [f"{'type':<14}{'samples':>8}{'answered':>9}{'type F1':>9}{'rho MAPE %':>12}{'E log-MAPE %':>14}"]
    for row in rows:
        numbers = f"{row['f1']:>9.2f}{row['density_mape']:>12.2f}{row['log_mape']:>14.2f}"
        lines.append(f"{row['type']:<14}{row['samples']:>8}{row['answered']:>9}{numbers}")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=HERE)
    parser.add_argument("--endpoint", metavar="URL")
    parser.add_argument("--model", metavar="NAME")
    parser.add_argument("--answers", metavar="JSON")
    parser.add_argument("--out", metavar="JSON", help="keep the endpoint's answers")
    options = parser.parse_args(arguments)
    if bool(options.answers) == bool(options.endpoint) or bool(options.endpoint) != bool(options.model):
        parser.error("give --answers, or --endpoint with --model")
    try:
        objects = read_truth(options.folder)
        answers = (
            read_answers(options.answers) if options.answers else ask_all(options.folder, objects, options.endpoint, options.model)
        )
    except SeeingWindError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    if options.out:
        Path(options.out).write_text(json.dumps(answers, indent=2) + "\n", encoding="utf-8")
    print(table(score(objects, answers)))
    return 0 if answers else 1


if __name__ == "__main__":
    sys.exit(main())

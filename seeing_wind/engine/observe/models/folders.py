"""Loading a model from a local folder or the hub's cache. Weights are safetensors, and the code is that of installed packages."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from safetensors import SafetensorError

from ...errors import MissingPackage, WrongModel
from ...reading import read_json
from .catalogue import KNOWN, cached, known

PICKLES = (".bin", ".pth", ".pt", ".ckpt", ".pkl")


def package(name: str, how: str) -> Any:
    """The module of an optional package.

    Raises:
        MissingPackage: it is not installed; `how` tells the user what to do.
    """
    if importlib.util.find_spec(name) is None:
        raise MissingPackage(f"The package {name} is not installed in the engine's environment.", how)
    return importlib.import_module(name)


def find(name: str, task: str) -> Path:
    """The folder of the model `name`, which is a folder itself or a name on the hub; `task`: what the model is for, see `Known.task`.

    Raises:
        WrongModel: no such folder, not in the cache, or no safetensors in it; the hint says how to get the model.
    """
    entry = known(name)
    folder = Path(name)
    if not os.path.isdir(name):  # unlike Path's, it accepts names that no file system allows
        found = cached(name) if name.count("/") == 1 and not name.startswith((".", "/", "~")) else None
        if found is None:
            wanted = entry.how if entry else f"Known for this: {', '.join(one.name for one in KNOWN if one.task == task)}."
            raise WrongModel(f"There is no folder {name}, and the hub's cache does not hold a model of that name.", wanted)
        folder = found
    files = sorted(path.name for path in folder.iterdir())
    if not any(one.endswith(".safetensors") for one in files):
        pickles = [one for one in files if one.endswith(PICKLES)]
        what = f"only {pickles[0]}, a pickle, which could run code" if pickles else f"{', '.join(files[:5]) or 'nothing'}"
        how = entry.how if entry else "Get the model's safetensors."
        raise WrongModel(f"The folder {folder} has no *.safetensors: it holds {what}.", how)
    return folder


def config_of(folder: Path) -> dict[str, Any]:
    """`config.json` of a model's folder.

    Raises:
        WrongModel: missing or not JSON.
    """
    try:
        values = read_json(folder / "config.json")
    except (OSError, ValueError) as error:
        raise WrongModel(f"The folder {folder} has no readable config.json ({error}).", "Copy all files of the model.") from error
    if not isinstance(values, dict):
        raise WrongModel(f"config.json of {folder} is not a JSON object.", "Copy all files of the model.")
    return values


def load(kind: Any, folder: Path, wanted: str) -> Any:
    """A transformers model of the class `kind` with the weights in `folder`, ready for inference.

    Raises:
        WrongModel: files of another model (`wanted` names the right one), damaged files, or incomplete weights, which transformers would
            fill with random numbers.
    """
    try:
        with quiet():
            model, report = kind.from_pretrained(folder, local_files_only=True, use_safetensors=True, output_loading_info=True)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError, SafetensorError) as error:
        first = (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
        raise WrongModel(f"The model in {folder} cannot be loaded: {first}", f"The folder must hold all files of {wanted}.") from error
    lacking = sorted(report["missing_keys"]) + sorted(str(one) for one in report.get("mismatched_keys", ()))
    if lacking:
        raise WrongModel(
            f"The weights in {folder} are incomplete: {len(lacking)} are missing, such as {lacking[0]}.",
            f"The folder must hold all files of {wanted}.",
        )
    return model.eval()


def load_plain(model: Any, folder: Path, wanted: str) -> Any:
    """`model`, a plain torch module from its authors' package, with the folder's safetensors loaded, ready for inference.

    Raises:
        WrongModel: damaged weights, or those of another model than `wanted`.
    """
    from safetensors.torch import load_file

    try:
        weights = {key: value for file in sorted(folder.glob("*.safetensors")) for key, value in load_file(file).items()}
        model.load_state_dict(weights)
    except (SafetensorError, RuntimeError) as error:
        first = str(error).splitlines()[0][:120]
        raise WrongModel(f"The weights in {folder} do not fit ({first}).", f"The folder must hold all files of {wanted}.") from error
    return model.eval()


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silence the progress bars and notes of transformers inside the `with`."""
    from transformers.utils import logging

    before, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    os.environ.setdefault("TOKENIZERS_PARALLELISM", "false")
    try:
        yield
    finally:
        logging.set_verbosity(before)
        if bars:
            logging.enable_progress_bar()

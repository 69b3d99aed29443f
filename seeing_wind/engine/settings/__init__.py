"""One frozen dataclass of settings per stage, and for each of their options one definition.

    observe.py, build.py, recover.py   the stages, the reports of the last among them
    wind.py      a recovered force, or the wind that makes it
    edit.py      what is re-simulated: bodies, colliders
    option.py    what an option is: help, unit, range, choices, flag; how it is checked, read from a word and written as one
    mapping.py   settings from plain mappings, and as such
    toml.py      plain mappings as TOML
    tables.py    the files that a user writes in TOML: edits, and the lists in others; needs NumPy

The command line, the panel's properties, the words that the panel gives the worker, docs/reference/cli.md and the errors come from the
options.
"""

from .build import FLOWING_PARTICLES, PARTICLES, SHEET_VERTICES, BuildSettings
from .edit import BodyEdit, ColliderEdit, Edit
from .mapping import from_mapping, to_mapping
from .observe import ObserveSettings
from .option import Option, options_of, words_of
from .recover import RecoverSettings, ReportSettings
from .toml import toml_text
from .wind import WindSettings

__all__ = [
    "FLOWING_PARTICLES", "PARTICLES", "SHEET_VERTICES", "BodyEdit", "BuildSettings", "ColliderEdit", "Edit", "ObserveSettings", "Option",
    "RecoverSettings", "ReportSettings", "WindSettings", "from_mapping", "options_of", "to_mapping", "toml_text", "words_of",
]  # fmt: skip

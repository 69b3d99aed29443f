"""One frozen dataclass of settings per stage, and one definition for each of its options.

    observe.py, build.py, recover.py   the stages; recover.py also has the report
    wind.py      whether a force is recovered, or the wind that causes it
    edit.py      what is re-simulated: bodies, colliders, further fields
    option.py    the definition of an option: help, unit, range, choices, flag; how a value is checked, read from words and written as words
    mapping.py   settings from plain mappings, and back
    toml.py      plain mappings as TOML
    tables.py    the files that a user writes in TOML: edits, and lists of tables in other files; needs NumPy

The command line, the panel's properties, the words that the panel passes to the worker, docs/reference/cli.md and error texts are all
derived from the options.
"""

from .build import FLOWING_PARTICLES, PARTICLES, SHEET_VERTICES, BuildSettings
from .edit import BodyEdit, ColliderEdit, Edit, FieldEdit
from .mapping import from_mapping, to_mapping
from .observe import ObserveSettings
from .option import Option, options_of, words_of
from .recover import RecoverSettings, ReportSettings
from .toml import toml_text
from .wind import WindSettings

__all__ = [
    "FLOWING_PARTICLES", "PARTICLES", "SHEET_VERTICES", "BodyEdit", "BuildSettings", "ColliderEdit", "Edit", "FieldEdit", "ObserveSettings",
    "Option", "RecoverSettings", "ReportSettings", "WindSettings", "from_mapping", "options_of", "to_mapping", "toml_text", "words_of",
]  # fmt: skip

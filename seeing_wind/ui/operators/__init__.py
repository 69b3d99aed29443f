"""The operators, thin: gather, call one function, report. All of them work from `blender -b --python` with keyword arguments."""

from ..clip import guess
from ..clip import operators as clip
from ..composite import operators as composite
from ..edit import edit_list as edits
from ..edit import operators as edit
from ..edit import resimulate
from ..field import operators as field
from ..install import operators as engine
from ..recover import operators as recover

CLASSES = (
    *clip.CLASSES, *guess.CLASSES, *recover.CLASSES, *edit.CLASSES, *edits.CLASSES, *resimulate.CLASSES, *field.CLASSES, *composite.CLASSES,
    *engine.CLASSES,
)  # fmt: skip

"""The operators, thin: gather, call one function, report. All of them work from `blender -b --python` with keyword arguments."""

from . import clip, composite, edit, edits, engine, field, guess, recover, resimulate

CLASSES = (
    *clip.CLASSES, *guess.CLASSES, *recover.CLASSES, *edit.CLASSES, *edits.CLASSES, *resimulate.CLASSES, *field.CLASSES, *composite.CLASSES,
    *engine.CLASSES,
)  # fmt: skip

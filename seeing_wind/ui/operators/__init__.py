"""The operators, thin: gather, call one function, report. All of them work from `blender -b --python` with keyword arguments."""

from . import edit, engine, recover, resimulate

CLASSES = (*recover.CLASSES, *edit.CLASSES, *resimulate.CLASSES, *engine.CLASSES)

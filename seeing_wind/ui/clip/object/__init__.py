"""Step 2, the object: which object is followed in the clip, its scale and its material.

properties     its settings, and a model's answers
operators      asks a model what is in the clip, and uses one of its answers (`clip/draw_box.py` draws the box)
correct        points that correct the outline, in any frame
held           marks the held place: as the preview proposes, or as a mesh is painted
preview        shows the engine's observations of the object before the solve
material_menu  the menu of materials, also used for bodies
panel          the panel *Object*
options        the settings as options of the worker, with the files that are made from the scene
"""

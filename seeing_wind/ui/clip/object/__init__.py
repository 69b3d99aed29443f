"""Step 2, the object: what is followed in the clip, at what scale, made of what.

properties     its settings, and what a model saw
operators      ask a model what is in the clip, use one of its answers (the box is drawn by `clip/draw_box.py`)
correct        points that correct the outline in any frame
held           where it is held: as the preview proposes, or as a mesh is painted
preview        what the engine sees of it, before the solve
material_menu  the menu of materials, of a body, too
panel          the panel *Object*
options        the settings as options of the worker, with the files that are made from the scene
"""

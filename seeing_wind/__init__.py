"""Seeing Wind: force fields recovered from video, as Blender force fields.

`seeing_wind.engine` runs in a worker process and never imports bpy; `seeing_wind.ui` runs in Blender and never imports torch,
Taichi or OpenCV. The ground floor of the engine (conventions, errors, progress, settings, records, materials, take) needs NumPy only
and is shared by both.
"""

"""Step 5, Re-simulate: the edit goes to the engine, its motion stays in a take until it is baked.

operators    Re-simulate, and its preview
panel        the panel *Re-simulate*
request      one snapshot of the scene's edit: values, digest, names; no NumPy
preview      what a preview is, and when it goes before the full result; no NumPy
edit_export  from the snapshot to what is written
edit_files   the files: meshes, pinned vertices, edit.toml
field_place     the field object as it stands in the scene
lone_wind       a wind without a take of its own
force_fields    Blender's own force fields that act beside the recovered one; no NumPy
further_forces  what they do, on a lattice
geometry     short digests of shape, place and weights; no NumPy, asked for at every change
"""

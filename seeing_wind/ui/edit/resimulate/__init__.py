"""Step 5, Re-simulate: the engine simulates the edit, and the motion is kept in a take until it is baked.

operators    Re-simulate, and its preview
panel        the panel *Re-simulate*
request      a snapshot of the scene's edit: values, digest, names; no NumPy
preview      what a preview is, and when it takes precedence over the full result; no NumPy
edit_export  from the snapshot to the data that is written
edit_files   the files: meshes, pinned vertices, edit.toml
field_place     field objects as they stand in the scene; no NumPy
further_fields  field objects that act beside the scene's own
lone_wind       a wind without a take of its own
force_fields    Blender's own force fields that act in addition to the recovered one; no NumPy
further_forces  the forces of these fields, sampled on a lattice
geometry     short digests of shape, place and weights, computed at every change; no NumPy
"""

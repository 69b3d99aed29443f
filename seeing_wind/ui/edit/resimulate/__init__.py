"""Step 5, Re-simulate: the edit goes to the engine, its motion stays in a take until it is baked.

operators    Re-simulate
panel        the panel *Re-simulate*
edit_export  from the scene's edit to what is written
edit_files   the files: meshes, pinned vertices, edit.toml
digest       of all that a re-simulation depends on; no NumPy, asked for at every change
"""

"""Step 4, the edit: the meshes inserted into the field, where they are held, how heavy they are and what they collide with.

properties  the settings of an edit: bodies, colliders, further edits
inserting   the operators that put meshes into the edit, as bodies and colliders
operators   pin, scale, release and remove bodies; remove colliders; duplicate and remove an edit
panel       the panel *Edit*
importing   import of meshes from files
from_file   fills the Edit list from an edit.toml that was simulated elsewhere
edits       several edits of one field: one is active, the others are stored
sheet_label what the panel displays for a body that will be a shell
cloth_look  a render material for cloth without one

`resimulate` is step 5.
"""

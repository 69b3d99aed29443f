"""Step 4, the edit: meshes that are put into the field, what is held, how heavy they are, what is in their way.

properties  its settings: bodies, colliders, further edits
operators   insert, remove, pin, scale, let go; colliders; duplicate and remove an edit
panel       the panel *Edit*
importing   meshes from files
from_file   the Edit list from an edit.toml that was simulated elsewhere
edits       several edits of one field: one is worked on, the others are kept
sheet_label what the panel says of a body that will be a shell
cloth_look  the material of cloth that has none

`resimulate` is step 5.
"""

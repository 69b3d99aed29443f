"""The recovered field in Blender: one native force field object, and how it is displayed.

properties    what solvers feel of it, and how it ends outside its box
operators     Apply to Field, Calibrate for Object, Export Field
panel         the panel *Field*
field_object  the object that is a Blender force field
lattice       the field on a regular lattice, as sampled by the engine
conform       its frames at the clip's own speed, whatever the scene's frame rate
samples       the field's values for Geometry Nodes, and the group *Sample Wind*
arrows        the arrows
legend        the colour bar beside them
display       names and texts of these objects; no NumPy
node_groups   concise building of Geometry Nodes groups
vdb           OpenVDB files

`texture` is what Blender's force field reads; `solvers` makes Blender's own solvers feel it as they should;
`library` holds the winds that come with the extension.
"""

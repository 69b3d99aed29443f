"""The recovered field in Blender: one native force field object, and how it is seen.

properties    what solvers feel of it, and how it ends beside its box
operators     Apply to Field, Calibrate for Object, Export Field
panel         the panel *Field*
field_object  the object that is a Blender force field
lattice       the field on a regular lattice, as the engine gave it
conform       its frames at the clip's own speed, whatever the scene's frame rate
samples       the field's values for Geometry Nodes, and the group *Sample Wind*
arrows        the arrows
legend        the bar of colours beside them
display       names and texts by which these objects are known; no NumPy
node_groups   building Geometry Nodes groups in few words
vdb           OpenVDB files

`texture` is what Blender's force field reads; `solvers` makes Blender's own solvers feel it as they should;
`library` has winds that come with the extension.
"""

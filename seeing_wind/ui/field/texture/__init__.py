"""A field on a lattice as one texture that Blender's force field of the type Texture reads: one look-up a place, however many nodes.

atlas      the lattice of all frames as one packed image
followers  small textures that say the current frame and how the field object is turned
tree       the texture nodes that read the atlas between its nodes
reach      what becomes of the field beside its box
"""

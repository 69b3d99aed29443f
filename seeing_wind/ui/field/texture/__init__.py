"""A field on a lattice as one texture for Blender's force field of type *Texture*: one look-up per point, however many nodes.

atlas      the lattice of all frames as one packed image
followers  small textures that hold the current frame and the rotation of the field object
tree       the texture nodes that interpolate in the atlas
reach      how the field behaves outside its box
"""

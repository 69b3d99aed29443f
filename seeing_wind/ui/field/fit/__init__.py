"""A sampled field as a sum of Blender's wind sources. NumPy only.

lattice   the field as the engine gave it, on a regular lattice, and its values in between
kernels   what one wind source does, and the least-squares fit of many
choose    how many sources, how they end beside the box, and how far their sum is off
"""

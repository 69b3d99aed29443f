"""Many clips and edits from one file: one after the other, on a Ray cluster, or as a bundle for a studio's farm.

`jobs`, `summary` and `in_order` need the standard library only: Blender's process uses them too.
"""

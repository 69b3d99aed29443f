"""The edit over the clip: holdout, shadows, clean plate, light and compositor.

operators  Set Up Composite, Render over Clip
panel      the panel *Composite*
light      where the clip's light came from
composite  setting it up, and rendering, in Blender 4.5 and 5
"""

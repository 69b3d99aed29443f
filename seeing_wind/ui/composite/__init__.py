"""The edit over the clip: holdout, shadows, clean plate, light and compositor.

operators  Set Up Composite, Render over Clip
panel      the panel *Composite*
light      the clip's sun and sky
catchers   what catches shadows: floor, wall, obstacles
mattes     the object's outline as pictures, the card that holds out by them, the clip's grain
nodes      the compositor, in Blender 4.5 and 5
composite  setting all of it up, and rendering
"""

"""The edit over the clip: holdout, shadows, clean plate, light, lens and compositor.

operators   Set Up Composite, Render over Clip
properties  its settings: the panorama that lights it
panel       the panel *Composite*
light       the clip's sun and sky
hdri        a panorama in their place
catchers    what catches shadows: floor, wall, obstacles
mattes      the object's outline as images, the card that holds out by them
film/       the clip's grain, how soft it is, its lens and what that is focused on
overscan    a wider render where the lens draws in what is beyond the borders
nodes       the compositor, in Blender 4.5 and 5
own         what an earlier set-up has left in the scene, and what of its camera and render settings changes
parts       what a composite is put together from, and what of it is missing
composite   setting all of it up, and rendering
"""

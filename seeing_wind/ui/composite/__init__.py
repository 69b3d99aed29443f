"""The edit over the clip: holdout, shadows, clean plate, light, lens and compositor.

operators   Set Up Composite, Render over Clip
properties  its settings: the panorama that lights it
panel       the panel *Composite*
light       the clip's sun and sky
hdri        a panorama in place of sun and sky
catchers    shadow catchers: floor, wall, obstacles
mattes      the object's outline as images, and the holdout card that uses them
film/       the clip's grain, softness, lens distortion and focus
overscan    a wider render, where the lens distortion shows points beyond the undistorted frame
nodes       the compositor, in Blender 4.5 and 5
own         finds objects of an earlier set-up, and lists and makes changes of camera and render settings
parts       the parts of a composite, and checks for missing ones
composite   sets all of it up, and renders
"""

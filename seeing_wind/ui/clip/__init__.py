"""Step 1, the clip: which video, which part of it, through which camera.

properties       its settings
operators        Choose Clip (also by drag and drop), Match Scene
on_frame         waiting for the mouse over the clip's frame
draw_box         Draw Box
marked           what is marked, drawn over the clip's first frame
views            further views: add, remove
panel            the panel *Clip*
options          the settings as options of the engine
match            what of the scene follows the clip, and what is left alone
clip_scene       the clip's camera with its frames behind; the recovered object's mesh
frame_on_screen  where the clip's frame lies on the screen

`inputs` writes what Blender knows of the clip for the engine; `object` is step 2, what is followed in it.
"""

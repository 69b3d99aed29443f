"""Step 1, the clip: which video, which part of it, through which camera.

properties       its settings
operators        Choose Clip (also by drag and drop), Match Scene
on_frame         mix-in of operators that wait for the mouse over the clip's frame
draw_box         Draw Box
marked           draws the marked boxes over the clip's first frame
views            further views: add, remove
panel            the panel *Clip*
options          the settings as options of the engine
match            which settings of the scene follow the clip, and which are left alone
clip_scene       the clip's camera with the clip as its background; the recovered object's mesh
frame_on_screen  where the clip's frame lies on the screen

`inputs` writes scene data about the clip as files for the engine; `object` is step 2, the object that is followed in the clip.
"""

"""Step 6, Bake: simulated motion as keyframes. The file then plays without this extension.

properties  its settings
operators   Bake to Keyframes, Clear Bake
panel       the panel *Bake*
bodies      bakes the motion of an edit's bodies, onto their own objects or onto copies
motion      bakes the motion of one mesh in the way that suits it
shapes      ... as absolute shape keys
rigid       ... as location and rotation keyframes
cache       ... as a point cache beside the file
smooth      removes ripples as short as an edge from a motion
plan        how to bake a motion, the mark that records how an object was baked, and motion left by removed bodies; no NumPy
at_rest     an object without its bake, and whether its own modifiers deform it over time
animation   animation curves, the same way in Blender 4 and 5, and where objects stand, for digests; no NumPy

It is beside `edit`, not in it: the recovered object is baked too, and every room that reads meshes or keyframes of the scene imports it.
"""

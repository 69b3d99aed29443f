"""Step 6, Bake: simulated motion as keyframes. The file then plays without this extension.

properties  its settings
operators   Bake to Keyframes, Clear Bake
panel       the panel *Bake*
bodies      the bodies of an edit get their motion, on their own object or on a copy
motion      one mesh and its motion, in the way that suits it
shapes      ... as absolute shape keys
rigid       ... as keys of location and rotation
cache       ... as a point cache beside the file
smooth      a motion without ripples of an edge's length
plan        how a motion is to be baked, and what an object says of how it was, and motion left by bodies that went; no NumPy
at_rest     an object as it is without its bake, and whether modifiers of its own move it
animation   animation curves, the same way in Blender 4 and 5; no NumPy

It stands beside `edit`, not in it: the recovered object is baked too, and all who read meshes or keyframes of the scene stand on it.
"""

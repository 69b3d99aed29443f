"""Step 3, Recover: what the engine is asked, and what comes back as objects of the scene.

properties      its settings, and what the scene notes of its results
operators       Recover, Reload, One Wind for All, Open Report
panel           the panel *Recover*
request         one snapshot of a scene: options, digest, and the files made from the scene
sampling        the field of a take at the places that the scene needs; asked of the engine
results         from a take to the scene: field, arrows, legend, camera, recovered object
simulated       from a re-simulation that was made elsewhere to the scene: its bodies, and the Edit list
fill            the panel's settings from a take that was made elsewhere
shown           which objects of a scene show its field; no NumPy
renew_in_place  new results in the objects of a former run, so that what points at them stays
"""

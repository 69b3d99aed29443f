"""Step 3, Recover: the request to the engine, and the results as objects of the scene.

properties      its settings, and what the scene records about its results
operators       Recover, Reload, One Wind for All, Open Report
panel           the panel *Recover*
request         one snapshot of a scene: options, digest, and the files made from the scene
sampling        asks the engine for the field of a take at the points that the scene needs
results         from a take to the scene: field, arrows, legend, camera, recovered object
simulated       imports a re-simulation that was made elsewhere: its bodies, and the Edit list
fill            fills the panel's settings from a take that was made elsewhere
shown           which objects of a scene show its field; no NumPy
renew_in_place  puts new results into the objects of a former run, so that references to these objects stay valid
"""

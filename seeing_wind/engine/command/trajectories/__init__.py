"""3D trajectories from a file: of a body's particles, or of a sheet's vertices.

    bodies.py    particles and targets                 sheets.py    a sheet's mesh, and how it is recovered
    file.py      what stands in the file, checked      material.py  what the body is made of
    spacing.py   how far apart particles are
"""

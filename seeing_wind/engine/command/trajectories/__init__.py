"""3D trajectories from a file: of a body's particles, or of a sheet's vertices.

    bodies.py    particles and targets                 sheets.py    a sheet's mesh, and its recovery
    file.py      reads and checks the file's content   material.py  the body's material
    spacing.py   the particles' spacing
"""

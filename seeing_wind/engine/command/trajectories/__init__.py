"""3D trajectories from a file: of a body's particles, or of a sheet's vertices.

    verb.py      `recover-trajectories`                sheets.py    a sheet's mesh, and its recovery
    bodies.py    particles and targets                 material.py  the body's material
    file.py      reads and checks the file's content   spacing.py   the particles' spacing
"""

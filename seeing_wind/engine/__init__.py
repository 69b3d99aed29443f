"""The engine: from a clip to a force field to a re-simulation. Importing this package imports nothing heavy.

    stages.py   observe -> build, each kept in the take     command/  the command line
    observe/    from a clip to an observation, and to a body of particles
    recovery/   from observed motion to the force that caused it, and on to other bodies; `paper`: the paper's own schedule
    field/      force fields                    mpm/    the solver and its derivatives     look/   images

The ground floor, which Blender's process may import too: conventions.py (units, axes, tuned numbers), errors.py, progress.py,
settings/ (one definition per option), records.py and masks.py (what stages pass on), record_arrays.py (records as arrays of a take),
materials.py, take.py (the folder of a clip), reading.py (files from outside), systems.py (what Linux, macOS and Windows do differently).
"""

__version__ = "0.1.0"

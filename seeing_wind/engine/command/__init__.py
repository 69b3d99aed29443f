"""The command line: one module for each of its concerns.

    arguments.py     verbs and options              verbs.py       what each verb does; the short ones
    recover.py       from a clip or trajectories    resimulate.py  an edit in the recovered field
    trajectories.py  3D trajectories from a file    doctor.py      what is installed, and what to do about the rest
    sheets.py        the same, of a sheet's mesh
    lock.py          one writer per take            reporting.py   how a recovery ends: its report, its result
    observe.py       what is seen, before the solve
    cancelling.py    how a parent or a person stops a job
    batch/           many clips and edits from one file, here or on a farm
"""

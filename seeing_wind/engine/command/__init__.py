"""The command line: one module for each of its concerns.

    arguments.py     verbs and options              verbs.py       what each verb does; the short ones
    recover.py       from a clip or trajectories    resimulate.py  an edit in the recovered field
    observe.py       what is seen, before the solve   join.py      one wind for several takes
    reporting.py     how a recovery ends: its report, its result
    lock.py          one writer per take            inputs.py      what a user gives is not overwritten
    cancelling.py  how a parent or a person stops a job
    doctor.py        what is installed, and what to do about the rest
    trajectories/    3D trajectories from a file
    batch/           many clips and edits from one file, here or on a farm
"""

"""The command line, by concern.

    arguments.py     verbs and options              verbs.py       what each verb does; the short ones
    recover.py       from a clip to a field         resimulate.py  an edit in the recovered field
    checks.py        what `recover` refuses before its work
    observe.py       what is seen, before the solve   join.py      one wind for several takes
    reporting.py     how a recovery ends: its report, its result
    lock.py          one writer per take            inputs.py      protects the user's files from being overwritten
    cancelling.py    how a parent process stops a job
    doctor.py        what is installed, and what to do about the rest
    trajectories/    3D trajectories from a file
    batch/           many clips and edits from one file, here or on a farm
"""

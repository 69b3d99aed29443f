"""Long jobs in a second process: one job, two drivers, and its display in the panel.

worker          runs a program as a generator of messages; no bpy
worker_command  the engine's command line and environment
operator        the base of operators that run jobs: a modal timer with a window, a loop without; Cancel
status          what the panels show: the plain state of each step; no bpy
notes           the notes of jobs on their results, stored with these
panel_words     the engine's messages with the panel's labels and the scene's frames
steps_shown     which steps the sidebar shows unfolded
panel_pieces    building blocks of all panels: the tab, states, failures with the button that mends them, bars
console         a job's messages as lines of text, for `blender -b`
takes           where the takes of a scene are, and which one it shows
take_along      copies results out of the temporary folder when a file is first saved
take_reading    reads and checks a take's files

`install` finds or makes the Python that the jobs run in.
"""

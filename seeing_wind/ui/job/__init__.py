"""Long jobs in a second process: one job, two drivers, and what the panel shows of it.

worker          a program as a generator of messages; no bpy
worker_command  the engine's command line and environment
operator        what all operators over jobs share: a modal timer with a window, a loop without; Cancel
status          what the panels show: plain state of each step, no bpy
notes           what jobs have said of their results, kept with these
panel_words     what the engine says of its flags and of frames, in the panel's words
steps_shown     which steps the sidebar shows unfolded
panel_pieces    what all panels are put together from: the tab, states, failures with their mend, bars
console         a job's messages as lines of text, for `blender -b`
takes           where the takes of a scene are, and which of them it shows
take_along      a file that is saved for the first time takes its results along
take_reading    what a take's files say, read and checked

`install` finds and makes the Python that the jobs run in.
"""

"""Many clips and edits from one file: one after the other, on a Ray cluster, or as a bundle for a studio's farm.

    verb.py      `batch JOBS.toml`                  jobs.py         the file of jobs
    in_order.py  runs one job after the other       summary.py      the jobs' outcomes, so that nothing is done twice
    farm.py      a batch on a Ray cluster           ray_cluster.py  the only module that uses Ray
    delivery.py  files to a node, and results back  node.py         a job on a node
    openjd.py    an Open Job Description            process.py      one verb in a process of its own
    needs.py     cores and memory of a job           words.py        a job's options on the command line

`jobs`, `words`, `summary` and `in_order` import only the engine's basic modules, as Blender's process uses them, too.
"""

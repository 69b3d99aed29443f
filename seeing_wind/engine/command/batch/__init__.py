"""Many clips and edits from one file: one after the other, on a Ray cluster, or as a bundle for a studio's farm.

    verb.py      `batch JOBS.toml`                 jobs.py      the file of jobs
    in_order.py  one job after the other           summary.py   what became of them, so that nothing is done twice
    farm.py      a batch on a Ray cluster          ray_cluster.py  the one door to Ray
    delivery.py  what goes to a node and comes back    node.py  a job there
    openjd.py    an Open Job Description           process.py   one verb in a process of its own
    needs.py     what a job takes of a machine

`jobs`, `summary` and `in_order` need the ground floor only: Blender's process uses them too.
"""

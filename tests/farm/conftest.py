"""A batch of quick jobs, and two real nodes of a Ray cluster on this machine."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from quick import QUICK, clip, trajectories  # noqa: E402


@pytest.fixture
def batch_of_eight(tmp_path: Path) -> Path:
    """JOBS.toml with six jobs from trajectories and two from one clip, the last with an edit."""
    tables = []
    for k in range(6):
        trajectories(tmp_path / f"t{k}.npz", float(k))
        tables.append(f'[[job]]\nname = "body {k}"\ntrajectories = "t{k}.npz"\ntake = "body{k}.take"\n{QUICK}\n')
    clip(tmp_path / "square.avi")
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "square"\nmesh = "recovered"\nmass_scale = 2.0\n')
    options = 'box = [19, 13, 53, 47], distance = 2.0, material = "leaf", particles = 60, iterations = 1'
    for name, more in (("square", ""), ("edited square", 'edit = "edit.toml"\n')):
        take = name.replace(" ", "_")
        tables.append(f'[[job]]\nname = "{name}"\nclip = "square.avi"\ntake = "{take}.take"\nrecover = {{ {options} }}\n{more}')
    jobs = tmp_path / "jobs.toml"
    jobs.write_text("\n".join(tables))
    return jobs


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two nodes with a raylet and an object store each, one of them also the head; a node has room for one job."""
    pytest.importorskip("ray", reason="the extra `farm` is not installed")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    from ray.cluster_utils import Cluster

    room = {"num_cpus": 1, "memory": 4 << 30, "object_store_memory": 100 << 20, "include_dashboard": False}
    running = Cluster(initialize_head=True, head_node_args=room)
    running.second = running.add_node(**room)
    running.wait_for_nodes()
    yield running
    running.shutdown()

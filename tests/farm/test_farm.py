"""A batch on two real nodes of a Ray cluster."""

from __future__ import annotations

import json
import pickle
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from quick import QUICK, messages, outcomes, start, trajectories

ray = pytest.importorskip("ray", reason="the extra `farm` is not installed")

from seeing_wind.engine.command.batch import ray_cluster  # noqa: E402
from seeing_wind.engine.errors import SeeingWindError, UsageError  # noqa: E402
from seeing_wind.engine.progress import Cancelled  # noqa: E402


def await_line(process: subprocess.Popen[str], holds) -> list[dict]:
    """Read messages until `holds` one of them; all that were read."""
    said = []
    for line in process.stdout:
        said.append(json.loads(line))
        if holds(said[-1]):
            return said
    raise AssertionError((said[-3:], process.stderr.read()[-2000:]))


def two_at_work(message: dict) -> bool:
    """Whether both nodes, which have room for one job each, are in the midst of theirs."""
    return sum(message.get("message", "").count(f" {stage} ") for stage in ("recover", "report", "observe", "build")) >= 2


def test_a_cancel_ends_all_jobs_and_leaves_nothing_half(cluster, batch_of_eight) -> None:
    process = start(batch_of_eight, "--ray", cluster.address)
    await_line(process, two_at_work)
    process.send_signal(signal.SIGINT)
    said = messages(process)
    assert process.returncode == 130 and said[-1]["outcome"] == "cancelled"
    ended = [row["outcome"] for row in outcomes(batch_of_eight).values()]
    assert "cancelled" in ended and set(ended) <= {"cancelled", "left", "done"}
    assert not list(batch_of_eight.parent.glob(".*.incoming"))
    engines = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    assert not [line for line in engines.splitlines() if "seeing_wind.engine recover" in line and str(batch_of_eight.parent) in line]


def test_a_shared_folder_and_a_job_that_fails(cluster, tmp_path) -> None:
    trajectories(tmp_path / "t.npz", 2.0)
    trajectories(tmp_path / "no.npz", 2.0)
    with np.load(tmp_path / "no.npz") as file:
        np.savez(tmp_path / "no.npz", **{**file, "fixed": np.ones(file["x"].shape[1], bool)})  # which only the solve refuses
    table = '[[job]]\nname = "{0}"\ntrajectories = "{0}.npz"\ntake = "{0}.take"\n{1}\n'
    jobs = tmp_path / "jobs.toml"
    jobs.write_text(table.format("t", QUICK) + table.format("no", QUICK))
    process = start(jobs, "--ray", cluster.address, "--shared")
    said = messages(process)
    assert process.returncode == 1 and "1 of 2 jobs failed. \"no\": All particles of the body are held" in said[-1]["message"]
    assert outcomes(jobs)["t"]["outcome"] == "done" and (tmp_path / "t.take" / "field.safetensors").is_file()


def test_eight_jobs_with_a_node_killed_end_as_on_one_machine(cluster, batch_of_eight, capsys) -> None:
    home = batch_of_eight.parent
    begun = time.monotonic()
    process = start(batch_of_eight)
    assert messages(process)[-1]["outcome"] == "converged" and process.returncode == 0
    alone = time.monotonic() - begun
    takes = sorted(home.glob("*.take"))
    assert len(takes) == 9  # the last job has an edit's
    for take in takes:
        take.rename(take.with_suffix(".reference"))
    batch_of_eight.with_name("jobs.summary.json").unlink()

    begun = time.monotonic()
    process = start(batch_of_eight, "--ray", cluster.address)
    said = await_line(process, two_at_work)
    cluster.remove_node(cluster.second, allow_graceful=False)
    said += messages(process)
    farm = time.monotonic() - begun
    assert process.returncode == 0, said[-1]
    warned = [each["message"] for each in said if each["type"] == "warning" and "attempt 2 of 3" in each["message"]]
    assert len(warned) == 1, said
    assert [row["outcome"] for row in outcomes(batch_of_eight).values()] == ["done"] * 8
    with capsys.disabled():
        print(f"\n8 jobs: {alone:.0f} s one after the other, {farm:.0f} s on two nodes with one killed; ratio {farm / alone:.2f}")
    assert {take.name: differences(take.with_suffix(".reference"), take) for take in takes} == {take.name: [] for take in takes}

    process = start(batch_of_eight, "--ray", cluster.address)
    said = messages(process)
    assert [each["outcome"] for each in said[-1]["jobs"]] == ["skipped"] * 8


def untimed(values: dict) -> dict:
    """A mapping without what tells how long something took, or was expected to take on that machine."""
    return {key: value for key, value in values.items() if key not in ("seconds", "expected_seconds")}


def differences(reference: Path, take: Path) -> list[str]:
    """Names of files and arrays that two takes do not share, but for times and frames of them."""
    names = [{path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} for folder in (reference, take)]
    wrong = sorted((names[0] ^ names[1]) - {"take.lock"})
    for name in sorted(names[0] & names[1]):
        ours, theirs = reference / name, take / name
        if name.endswith(".npz"):
            with np.load(ours) as a, np.load(theirs) as b:
                keys = ({*a.files} | {*b.files}) - {"seconds"}
                wrong += [f"{name} {key}" for key in sorted(keys) if key not in a or key not in b or not np.array_equal(a[key], b[key])]
        elif name.endswith(".json"):
            a, b = (json.loads(path.read_text(), object_hook=untimed) for path in (ours, theirs))
            wrong += [f"{name} {key}" for key in a.keys() | b.keys() if a.get(key) != b.get(key)]
        elif name == "take.toml":
            a, b = (tomllib.loads(path.read_text()) for path in (ours, theirs))
            for stages in (a["stages"], b["stages"]):
                stages.get("report", {}).pop("stamp", None)  # that of the path which the clip had
            wrong += [name] * (a != b)
        elif name not in ("report.png", "overlay.mp4", "take.lock") and ours.read_bytes() != theirs.read_bytes():
            wrong.append(name)
    return wrong


def test_nodes_with_another_engine_or_none_are_named_before_anything_starts(cluster, monkeypatch) -> None:
    with ray_cluster.Cluster(cluster.address) as found:
        found.check(lambda: None)
        monkeypatch.setattr(ray_cluster, "edition", lambda: "9.9 (0)")
        with pytest.raises(SeeingWindError, match=r"The node .* has the engine 0\..*; this machine has 9\.9"):
            found.check(lambda: None)

        def stop() -> None:
            raise Cancelled

        with pytest.raises(Cancelled):
            found.check(stop)
    sent = ray.cloudpickle.dumps(ray_cluster.node_probe())
    code = "import pickle, sys; sys.modules['seeing_wind'] = None; print(pickle.load(sys.stdin.buffer)())"
    said = subprocess.run([sys.executable, "-c", code], input=sent, capture_output=True, check=True, cwd="/").stdout
    assert said.startswith(b"lacks the engine")
    assert pickle.loads(sent)() == ray_cluster.node_probe()()


def test_no_cluster_and_wrong_addresses(tmp_path) -> None:
    for address in ("127.0.0.1:1", "nowhere"):
        with pytest.raises(SeeingWindError, match=f"There is no Ray cluster at {address}"):
            ray_cluster.Cluster(address)
    with pytest.raises(UsageError, match="Ray's client"):
        ray_cluster.Cluster("ray://127.0.0.1:10001")
    shutil.rmtree(tmp_path)

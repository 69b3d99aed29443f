"""A batch as an Open Job Description: what is in the template, and each step run by `openjd-cli`, Blender's with a stand-in."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from quick import QUICK, ROOT, clip, trajectories

from seeing_wind.engine.command.batch.jobs import read_jobs
from seeing_wind.engine.command.batch.openjd import ENGINE, write_bundle
from seeing_wind.engine.errors import ClipError, UsageError
from seeing_wind.engine.progress import NoProgress

JOBS = """
[[job]]
name = "leaf"
clip = "square.avi"
take = "leaf.take"
recover = { box = [19, 13, 53, 47], distance = 2.0, material = "leaf", particles = 60, iterations = 1 }
edit = "edit.toml"
save = "leaf.blend"
render = "leaf_edited.mp4"

[[job]]
name = "heavy"
take = "leaf.take"
edit = "edit.toml"
edit_take = "heavy.take"
"""

BLENDER = '''#!{python}
"""Stands for Blender: looks at its arguments, and writes what Blender would."""
import sys
from pathlib import Path

words = sys.argv[1:]
home = Path({home!r})
with open(home / "blender.log", "a") as log:
    print(*words, file=log)
if words[:3] == ["--command", "seeing_wind", "bake"]:
    take, options = Path(words[3]), dict(zip(words[4:-1:2], words[5:-1:2]))
    assert (take / "field.safetensors").is_file() and words[-1] == "--composite", words
    assert (Path(options["--edit-take"]) / "bodies" / "square.npz").is_file() and Path(options["--clip"]).is_file(), words
    Path(options["--save"]).write_text("a file")
elif words[0] == "--background":
    assert Path(words[1]).read_text() == "a file" and words[2] == "--render-output", words
    assert words[4:8] == ["--render-format", "PNG", "--use-extension", "1"], words
    frames = Path(words[3])
    frames.parent.mkdir(exist_ok=True)
    assert words[8] == "--render-frame" and frames.name == "####", words
    (frames.parent / f"{{int(words[9]):04d}}.png").write_text("a frame")
else:
    assert words == ["--command", "seeing_wind", "--help"], words
'''


@pytest.fixture
def workplace(tmp_path: Path) -> Path:
    """A clip, an edit and a file of jobs."""
    clip(tmp_path / "square.avi")
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "square"\nmesh = "recovered"\nmass_scale = 2.0\n')
    (tmp_path / "jobs.toml").write_text(JOBS)
    return tmp_path


def bundle_of(folder: Path) -> tuple[dict, dict]:
    """The template of a folder's jobs, and what the verb says."""
    said = write_bundle(read_jobs(folder / "jobs.toml"), folder / "jobs.toml", folder / "bundle", NoProgress())
    return json.loads((folder / "bundle" / "template.json").read_text()), said


def test_steps_depend_on_what_they_need(workplace) -> None:
    template, said = bundle_of(workplace)
    steps = {step["name"]: [each["dependsOn"] for each in step.get("dependencies", ())] for step in template["steps"]}
    assert steps == {
        "leaf: recover": [],
        "leaf: re-simulate": ["leaf: recover"],
        "leaf: bake": ["leaf: re-simulate"],
        "leaf: render": ["leaf: bake"],
        "heavy: re-simulate": ["leaf: recover"],
    }
    render = next(step for step in template["steps"] if step["name"] == "leaf: render")
    assert render["parameterSpace"]["taskParameterDefinitions"] == [{"name": "Frame", "type": "INT", "range": "1-5"}]
    assert said["frames"] == 5 and said["steps"] == list(steps)
    assert str(workplace) not in (workplace / "bundle" / "template.json").read_text()
    assert json.loads((workplace / "bundle" / "parameters.json").read_text()) == {"Folder": str(workplace), "Engine": str(ROOT)}


def test_frames_and_folders(workplace, tmp_path_factory) -> None:
    away = tmp_path_factory.mktemp("away")
    clip(away / "far.avi")
    table = '[[job]]\nname = "{0}"\nclip = "{1}"\ntake = "{0}.take"\nrender = "{0}.mp4"\n'
    (workplace / "jobs.toml").write_text(
        table.format("far", away / "far.avi") + table.format("part", "square.avi") + 'recover = { frames = "1:3" }\n'
    )
    template, said = bundle_of(workplace)
    assert said["frames"] == 5 + 3
    recover = template["steps"][0]["script"]["actions"]["onRun"]["args"]
    assert recover == ["-c", ENGINE, "recover", "{{Param.Folder1}}/far.avi", "--take", "{{Param.Folder}}/far.take"]
    assert {each["name"] for each in template["parameterDefinitions"]} == {"Folder", "Folder1", "Python", "Engine", "Edition", "Blender"}
    (workplace / "square.avi").write_bytes(b"no clip")
    (workplace / "jobs.toml").write_text(table.format("broken", "square.avi"))
    with pytest.raises(ClipError, match="holds no frame"):
        bundle_of(workplace)


def test_networks_are_found_from_the_folders(workplace, tmp_path_factory) -> None:
    away = tmp_path_factory.mktemp("away")
    (away / "net.tgz").touch()
    (workplace / "depth").mkdir()
    table = '[[job]]\nname = "leaf"\nclip = "square.avi"\ntake = "leaf.take"\nrecover = {{ outline_model = "{}", depth_model = "{}" }}\n'
    for given, words in (
        ((away / "net.tgz", "depth"), ["{{Param.Folder1}}/net.tgz", "--depth-model", "{{Param.Folder}}/depth"]),
        (("none", "apple/DepthPro-hf"), ["none", "--depth-model", "apple/DepthPro-hf"]),
    ):
        (workplace / "jobs.toml").write_text(table.format(*given))
        template, _ = bundle_of(workplace)
        assert template["steps"][0]["script"]["actions"]["onRun"]["args"][6:] == ["--outline-model", *words]


@pytest.mark.parametrize(("name", "says"), [("a {{b}}", "double braces"), ("long " * 13, "too long for a step")])
def test_names_that_a_template_cannot_hold(workplace, name, says) -> None:
    trajectories(workplace / "t.npz", 1.0)
    (workplace / "jobs.toml").write_text(f'[[job]]\nname = "{name}"\ntrajectories = "t.npz"\ntake = "t.take"\n{QUICK}\n')
    with pytest.raises(UsageError, match=says):
        bundle_of(workplace)


def openjd(folder: Path, command: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run `openjd-cli` on a folder's bundle, with the values of this machine."""
    pytest.importorskip("openjd.model", reason="openjd-cli is not installed")
    program = [str(Path(sys.executable).with_name("openjd")), command, str(folder / "bundle" / "template.json")]
    if command == "run":
        options = ("-p", f"file://{folder / 'bundle' / 'parameters.json'}", "-p", f"Blender={folder / 'blender'}", *options)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return subprocess.run([*program, *options], capture_output=True, text=True, timeout=600, env=environment)


def test_openjd_runs_every_step(workplace) -> None:
    template, _ = bundle_of(workplace)
    blender = workplace / "blender"
    blender.write_text(BLENDER.format(python=sys.executable, home=str(workplace)))
    blender.chmod(0o755)
    checked = openjd(workplace, "check")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    for step in template["steps"]:
        ran = openjd(workplace, "run", "--step", step["name"], "--no-run-dependencies")
        assert ran.returncode == 0, (step["name"], ran.stdout[-3000:])
    assert all((workplace / take / "bodies" / "square.npz").is_file() for take in ("leaf.edit.take", "heavy.take"))
    assert sorted(path.name for path in (workplace / "leaf_edited.frames").iterdir()) == [f"{frame:04d}.png" for frame in range(1, 6)]
    assert (workplace / "blender.log").read_text().count("--render-frame") == 5


def test_a_machine_with_another_engine_says_so(workplace) -> None:
    bundle_of(workplace)
    ran = openjd(workplace, "run", "-p", "Edition=9.9 (0)", "--step", "leaf: recover")
    assert ran.returncode != 0 and "this machine has the engine 0." in ran.stdout
    assert not (workplace / "leaf.take").exists()

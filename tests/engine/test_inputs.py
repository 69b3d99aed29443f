"""What a user gives is never overwritten by a job that writes a take beside it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.inputs import refuse_of_another, refuse_of_another_edit, refuse_result
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.errors import ClipError, UsageError
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.take import Take
from tests.engine.fields import UniformField

MINE = b"mine, and the only copy"


def run(*words: object) -> dict:
    arguments = parser().parse_args([str(word) for word in words])
    return VERBS[arguments.verb](arguments, NoProgress())


@pytest.fixture
def mine(tmp_path: Path) -> Callable[[str], Path]:
    """A file of the user's, of that name, in the folder `own`."""

    def make(name: str) -> Path:
        path = tmp_path / "own" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(MINE)
        return path

    return make


def refused(path: Path, *words: object, says: str) -> None:
    before = {each: each.read_bytes() for each in path.parent.rglob("*") if each.is_file()}
    with pytest.raises(UsageError, match=says) as error:
        run(*words)
    assert error.value.exit_code == 2 and "--take" in error.value.hint
    assert {each: each.read_bytes() for each in path.parent.rglob("*") if each.is_file()} == before


@pytest.mark.parametrize(("verb", "name"), [("observe", "preview.mp4"), ("recover", "overlay.mp4"), ("recover", "resimulated.mp4")])
def test_a_clip_in_the_take_under_the_name_of_a_takes_file_stays(mine, verb: str, name: str) -> None:
    path = mine(name)
    refused(path, verb, path, "--take", path.parent, "--box", 1, 1, 9, 9, says=f"{name} lies in the take")
    # A link has a name, too, and is what a result would take the place of.
    if hasattr(os, "symlink"):
        link = path.with_name("report.png")
        link.symlink_to(path.rename(path.with_name("clip.mp4")))
        refused(link, verb, link, "--take", path.parent, "--box", 1, 1, 9, 9, says="report.png lies in the take")


def test_so_do_all_that_options_name(mine, tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(MINE)
    for verb in ("observe", "recover"):
        for option, name in [("tracks", "observation.npz"), ("mask", "preview.png"), ("camera", "report.json"), ("pin", "report.png")]:
            path = mine(name)
            refused(path, verb, clip, "--take", path.parent, f"--{option}", path, says=f"--{option} .*{name} lies in the take")
    path, second = mine("wind.json"), clip.with_name("second.mp4")
    second.write_bytes(MINE)
    refused(path, "recover", clip, "--take", path.parent, "--view", second, path, clip, says="--view .*wind.json lies in the take")


def test_so_do_trajectories(tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    path = tmp_path / "own" / "trajectory.npz"
    x = 0.1 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    np.savez(path, x=np.stack([x - [0, 0, 0.01 * t * t] for t in range(6)]), fps=24.0, E=1e5)
    refused(path, "recover-trajectories", path, "--take", path.parent, says="lies in the take")


@pytest.fixture
def windy(tmp_path: Path) -> Path:
    """A take with a field in it."""
    take = tmp_path / "windy.take"
    take.mkdir()
    UniformField(np.array([[0.0] * 3, [1.0] * 3]), 25.0, 4, np.zeros(3)).save(take / "field.safetensors")
    return take


def test_so_do_an_edit_and_the_meshes_that_it_names(mine, windy: Path, tmp_path: Path) -> None:
    take, edit = windy, tmp_path / "edit.toml"
    mesh = mine("bodies/leaf.npz")
    edit.write_text('[[body]]\nname = "leaf"\nmesh = "own/bodies/leaf.npz"\n')
    refused(mesh, "resimulate", take, "--edit", edit, "--take", mesh.parents[1], says="leaf.npz of .* lies in the take")
    edit.rename(tmp_path / "own" / "resimulation.json")
    edit = tmp_path / "own" / "resimulation.json"
    refused(edit, "resimulate", take, "--edit", edit, "--take", edit.parent, says="resimulation.json lies in the take")


@pytest.mark.parametrize("name", ["report.json", "bodies/leaf.npz", "shot.mp4", "plates/0001.png"])
def test_a_folder_of_somebody_s_files_does_not_become_a_take(mine, windy: Path, tmp_path: Path, name: str) -> None:
    path, clip, edit = mine(name), mine("clip.mp4"), mine("edit.toml")
    truth = tmp_path / "truth.npz"
    edit.write_text('[[body]]\nname = "leaf"\nmesh = "recovered"\n')
    x = 0.1 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    np.savez(truth, x=np.stack([x - [0, 0, 0.01 * t * t] for t in range(5)]), fps=24.0, E=1e5)
    (tmp_path / "objects.json").write_text("{}")
    into, asked = ["--take", tmp_path / "own"], ["--material-endpoint", "http://localhost:1/v1", "--material-model", "any"]
    for words, others in (
        (["observe", clip, *into, "--box", 1, 1, 9, 9], ("edit.toml",)),
        (["recover", clip, *into, "--box", 1, 1, 9, 9], ("edit.toml",)),
        (["recover", clip, *into, "--objects", tmp_path / "objects.json"], ("edit.toml",)),
        (["identify", clip, *into, *asked], ("edit.toml",)),
        (["recover-trajectories", truth, *into], ("clip.mp4", "edit.toml")),
        (["resimulate", windy, "--edit", edit, *into], ("clip.mp4",)),
    ):
        named = ", ".join(sorted([*others, name.split("/")[0]]))
        refused(path, *words, says=f"own is not a take and holds {named}\\.")


def test_of_many_files_the_first_are_named(mine, tmp_path: Path) -> None:
    clip = mine("clip.mp4")
    for number in range(6):
        mine(f"plate{number}.png")
    words = ["recover", clip, "--take", clip.parent, "--box", 1, 1, 9, 9]
    refused(clip, *words, says="holds plate0.png, plate1.png, plate2.png and 3 more\\.")


def test_a_folder_of_what_the_job_reads_and_what_programs_leave_becomes_a_take(mine, windy: Path, tmp_path: Path) -> None:
    """The clip is none, which is told after; nothing of the attempt is left."""
    clip, mask = mine("clip.mp4"), mine("masks/first.png")
    for name in (".DS_Store", "Thumbs.db", "blender_inputs/camera.json", "objects.json", "objects/leaf.png"):
        mine(name)
    before = set(clip.parent.rglob("*"))
    for verb in ("observe", "recover"):
        with pytest.raises(ClipError):
            run(verb, clip, "--take", clip.parent, "--mask", mask)
        assert set(clip.parent.rglob("*")) == before
    edit, leaf = mine("panel/edit.toml"), mine("panel/leaf.obj")
    mine("panel/flag.obj")  # of a former attempt
    edit.write_text('# scene 1\n[[body]]\nname = "leaf"\nmesh = "leaf.obj"\n')
    with pytest.raises(UsageError, match="leaf.obj"):
        run("resimulate", windy, "--edit", edit, "--take", edit.parent)
    assert sorted(path.name for path in edit.parent.iterdir()) == ["edit.toml", "flag.obj", "leaf.obj"] and leaf.read_bytes() == MINE


@pytest.mark.parametrize("deep", ["edit", "a/b/edit"])
def test_no_take_is_made_inside_a_take(mine, windy: Path, tmp_path: Path, deep: str) -> None:
    clip, edit = mine("clip.mp4"), tmp_path / "edit.toml"
    edit.write_text('[[body]]\nname = "leaf"\nmesh = "recovered"\n')
    field = windy / "field.safetensors"
    refused(field, "resimulate", windy, "--edit", edit, "--take", windy / deep, says="edit is inside the take .*windy.take")
    refused(field, "recover", clip, "--take", windy / deep, "--box", 1, 1, 9, 9, says="edit is inside the take .*windy.take")
    assert sorted(windy.iterdir()) == [field]
    Take(windy / deep).finish("resimulate", "0", {"edit": str(edit)})  # as an earlier version did
    with pytest.raises(UsageError, match="has no recovered object"):
        run("resimulate", windy, "--edit", edit, "--take", windy / deep)


@pytest.mark.parametrize("sign", ["take.toml", "take.lock"])
def test_a_take_goes_on_whatever_files_it_holds_and_what_it_proposed_is_read(mine, tmp_path: Path, sign: str) -> None:
    """A job that was killed before it stamped its first stage has left no more than the lock. The clip is none, which is told after."""
    clip, held = tmp_path / "clip.mp4", mine("held.png")
    mine("observation.npz").with_name(sign).write_text("format = 1\n")
    clip.write_bytes(MINE)
    with pytest.raises(ClipError):
        run("recover", clip, "--take", held.parent, "--box", 1, 1, 9, 9, "--pin", held)
    assert held.read_bytes() == MINE


@pytest.mark.parametrize("verb", ["observe", "recover"])
def test_a_take_of_another_clip_stays(mine, tmp_path: Path, verb: str) -> None:
    pole, clay, take = mine("pole.mp4"), tmp_path / "clay.mp4", mine("pole.take/field.safetensors").parent
    clay.write_bytes(b"another film")
    (take / "take.toml").write_text(f'format = 1\n[stages.observe]\nstamp = "0"\n[stages.observe.settings]\nclip = "{pole}"\n')
    refused(take / "field.safetensors", verb, clay, "--take", take, "--box", 1, 1, 9, 9, says="pole.take is the take of another clip")
    copied = tmp_path / "copied.mp4"
    copied.write_bytes(MINE)
    refuse_of_another(Take(take), str(copied))
    moved = pole.rename(tmp_path / pole.name)
    refuse_of_another(Take(take), str(moved))
    with pytest.raises(UsageError, match="another clip"):
        refuse_of_another(Take(take), str(clay))


def test_a_take_of_a_clip_or_of_other_trajectories_stays(tmp_path: Path) -> None:
    x = 0.1 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for name, gust in (("a.npz", 0.01), ("b.npz", 0.02)):
        np.savez(tmp_path / name, x=np.stack([x - [0, 0, gust * t * t] for t in range(5)]), fps=24.0, E=1e5)
    a, b, clip, take = (tmp_path / name for name in ("a.npz", "b.npz", "clip.mp4", "a.take"))
    clip.write_bytes(MINE)
    quickly = ["--take", take, "--iterations", 1, "--report", "none", "--representation", "point"]
    run("recover-trajectories", a, *quickly)
    refused(take / "take.toml", "recover-trajectories", b, *quickly, says="a.take is the take of another file of trajectories, .*a.npz")
    refused(take / "take.toml", "recover", clip, "--take", take, "--box", 1, 1, 9, 9, says="of another file of trajectories")
    assert run("recover-trajectories", a, *quickly)["outcome"]
    (take / "take.toml").write_text(f'format = 1\n[stages.observe]\nstamp = "0"\n[stages.observe.settings]\nclip = "{clip}"\n')
    refused(take / "take.toml", "recover-trajectories", a, *quickly, says="a.take is the take of another clip")


def test_a_re_simulation_of_another_edit_stays(mine, windy: Path, tmp_path: Path) -> None:
    first, flag, second = mine("first.toml"), mine("out/bodies/flag.npz"), tmp_path / "second.toml"
    out, leaf = flag.parents[1], '[[body]]\nname = "leaf"\nmesh = "leaf.obj"\n'
    (out / "take.toml").write_text(f'format = 1\n[stages.resimulate]\nstamp = "0"\n[stages.resimulate.settings]\nedit = "{first}"\n')
    second.write_text(leaf)
    refused(flag, "resimulate", windy, "--edit", second, "--take", out, says="out holds the re-simulation of another edit")
    own = out / "edit.toml"
    for mended in (first, own):  # what changed since in its place, and what the panel writes into the folder, is the folder's edit
        mended.write_text(leaf)
        refuse_of_another_edit(Take(out), mended)


@pytest.mark.parametrize("made", ["observation.npz", "solve.npz", "field.safetensors"])
def test_a_recovery_stays_where_a_re_simulation_should_go(mine, windy: Path, tmp_path: Path, made: str) -> None:
    edit, made_there = tmp_path / "edit.toml", mine(made)
    edit.write_text('[[body]]\nname = "leaf"\nmesh = "leaf.obj"\n')
    words = ["resimulate", windy, "--edit", edit, "--take"]
    refused(made_there, *words, made_there.parent, says="own is the take of a recovery, not the folder of a re-simulation")
    Take(made_there.parent).finish("observe", "0", {"clip": "pole.mp4"})
    refused(made_there, *words, made_there.parent, says="own is the take of a recovery of pole.mp4, not the folder")
    refused(windy / "field.safetensors", *words, windy, says="windy.take is the take of a recovery")


def test_a_re_simulation_stays_where_a_recovery_should_go_and_is_done_again(windy: Path, tmp_path: Path) -> None:
    edit, out, clip = tmp_path / "edit.toml", tmp_path / "out", tmp_path / "clip.mp4"
    edit.write_text('[[body]]\nname = "leaf"\nmesh = "leaf.obj"\n')
    cube = [(x, y, z) for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    (tmp_path / "leaf.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in cube) + "".join(f"f {each}\n" for each in faces))
    resimulated = ["resimulate", windy, "--edit", edit, "--take", out]
    run(*resimulated)
    clip.write_bytes(MINE)
    x = 0.1 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    np.savez(tmp_path / "truth.npz", x=np.stack([x - [0, 0, 0.01 * t * t] for t in range(5)]), fps=24.0, E=1e5)
    says = "out holds a re-simulation of .*edit.toml, not a recovery"
    for verb in ("observe", "recover"):
        refused(out / "resimulation.json", verb, clip, "--take", out, "--box", 1, 1, 9, 9, says=says)
    refused(out / "resimulation.json", "recover-trajectories", tmp_path / "truth.npz", "--take", out, says=says)
    edit.write_text(edit.read_text() + "mass_scale = 2.0\n")
    assert run(*resimulated)["outcome"] == "converged"


def test_a_file_that_an_edit_names_is_missed_before_the_work(windy: Path, tmp_path: Path) -> None:
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "leaf"\nmesh = "recovered"\n[[collider]]\nname = "wall"\nmesh = "wall.obj"\n')
    with pytest.raises(UsageError, match="There is no file wall.obj of .*edit.toml"):
        run("resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("made", ["take.toml", "field.safetensors"])
def test_no_result_takes_the_place_of_a_takes_own_file(tmp_path: Path, made: str) -> None:
    refuse_result(tmp_path / "overlay.mp4")
    (tmp_path / made).touch()
    for name in ("field.safetensors", "observation.npz", "overlay.mp4", "report.png", "gaussians.ply", "view12.npz"):
        with pytest.raises(UsageError, match="is a file of the take"):
            refuse_result(tmp_path / name)
    refuse_result(tmp_path / "forces.npz")

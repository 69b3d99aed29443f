"""The walls of the house: no bpy in the engine, nothing heavy in Blender's process, imports that point down."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "seeing_wind"
HEAVY = ("torch", "taichi", "quadrants", "cv2", "scipy", "matplotlib", "trimesh", "safetensors")
GROUND = ("conventions", "errors", "progress", "settings", "masks", "records", "record_arrays", "take", "materials", "reading", "systems")
BATCH = tuple(f"seeing_wind.engine.command.batch.{name}" for name in ("jobs", "words", "summary", "in_order"))
"""Modules of `engine/command/batch/` that both sides use; they stand on the ground floor too."""


def imported(path: Path) -> set[str]:
    """Absolute names of all that a file imports, also inside functions; relative imports resolved."""
    names: set[str] = set()
    parts = path.relative_to(ROOT).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            home = ".".join(parts[: len(parts) - node.level]) if node.level else ""
            base = ".".join(part for part in (home, node.module or "") if part)
            names.add(base)
            names.update(f"{base}.{alias.name}" for alias in node.names)
    return names


def of_the_engine(names: set[str]) -> set[str]:
    """The engine's modules and rooms among `names`, but for the batch's modules of the ground floor."""
    ours = {name for name in names if name.startswith("seeing_wind.engine.")}
    return {name.split(".")[2] for name in ours if not any(f"{name}.".startswith(f"{one}.") for one in BATCH)}


def files(folder: Path) -> list[Path]:
    found = sorted(folder.rglob("*.py"))
    assert found
    return found


def test_the_engine_imports_neither_blender_nor_the_panel() -> None:
    for path in files(PACKAGE / "engine"):
        wrong = {name for name in imported(path) if name.split(".")[0] in ("bpy", "mathutils") or name.startswith("seeing_wind.ui")}
        assert not wrong, path


@pytest.mark.parametrize("name", [*GROUND, *(name.removeprefix("seeing_wind.engine.").replace(".", "/") for name in BATCH)])
def test_the_ground_floor_needs_numpy_only(name: str) -> None:
    place = PACKAGE / "engine" / name
    for path in files(place) if place.is_dir() else [place.with_suffix(".py")]:
        names = imported(path)
        assert not {found for found in names if found.split(".")[0] in HEAVY}
        assert of_the_engine(names) <= set(GROUND)


def test_the_panel_stands_on_the_ground_floor_only() -> None:
    for path in files(PACKAGE / "ui"):
        names = imported(path)
        assert not {name for name in names if name.split(".")[0] in HEAVY}, path
        assert of_the_engine(names) <= set(GROUND), path
        assert not {name for name in names if name.startswith("seeing_wind") and name.split(".")[1:2] not in (["ui"], ["engine"], [])}, path


def test_imports_are_relative() -> None:
    """Inside Blender the package has another name."""
    for path in files(PACKAGE):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        absolute = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level]
        assert not [node.module for node in absolute if (node.module or "").split(".")[0] == "seeing_wind"], path


def test_importing_and_registering_the_panel_loads_nothing_heavy() -> None:
    code = (
        "import sys, seeing_wind.ui as ui; ui.register(); ui.look_round(); ui.unregister(); ui.register();"
        f"print('loaded', sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert "loaded []" in done.stdout, done.stdout + done.stderr
    assert done.returncode == 0, "the process must end by itself, the add-on still switched on"


def run(code: str) -> str:
    """What a Python of its own prints that runs `code` from the root."""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_switching_on_reads_nothing_that_works_on_results() -> None:
    """Blender starts faster by it: NumPy alone takes a tenth of a second."""
    said = run(
        "import sys, seeing_wind.ui as ui; ui.register(); ui.look_round();"
        "print('read', *sorted(name for name in sys.modules if name.startswith('seeing_wind'))); ui.unregister()"
    )
    read = next(line for line in said.splitlines() if line.startswith("read ")).split()[1:]
    works_on_results = {
        "recover.results", "recover.sampling", "bake.motion", "bake.bodies", "clip.inputs.scene_inputs", "edit.edits",
        "composite.composite",
    }  # fmt: skip
    for name in works_on_results:
        assert PACKAGE.joinpath("ui", *name.split(".")).with_suffix(".py").is_file()
    assert "seeing_wind.ui.job.panel_pieces" in read and not {f"seeing_wind.ui.{name}" for name in works_on_results} & set(read)
    for name in read:
        path = PACKAGE.joinpath(*name.split(".")[1:])
        tree = ast.parse((path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8"))
        top = {alias.name for node in tree.body if isinstance(node, ast.Import) for alias in node.names}
        assert "numpy" not in top, f"{name} imports NumPy"


def test_the_add_ons_preferences_can_walk_all_modules() -> None:
    """Blender's `addon_utils._extensions_warnings_get` reads `__file__` of every module there is; a module that is read at that very
    moment changes the dictionary under its feet."""
    said = run(
        "import sys, seeing_wind.ui as ui; ui.register(); ui.look_round()\n"
        "for module in sys.modules.values(): getattr(module, '__file__', None)\n"
        "print('kinds', *{type(module).__name__ for name, module in sys.modules.items() if name.startswith('seeing_wind')})\n"
        "ui.unregister()"
    )
    assert "kinds module\n" in said, "each is read, or not there yet"

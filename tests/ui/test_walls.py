"""The walls of the house: no bpy in the engine, nothing heavy in Blender's process, imports that point down."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "seeing_wind"
HEAVY = ("torch", "taichi", "cv2", "scipy", "matplotlib", "trimesh", "safetensors")
GROUND = ("conventions", "errors", "progress", "settings", "records", "take", "materials", "sequences", "systems")


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


def files(folder: Path) -> list[Path]:
    found = sorted(folder.rglob("*.py"))
    assert found
    return found


@pytest.mark.parametrize("path", files(PACKAGE / "engine"), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_the_engine_imports_neither_blender_nor_the_panel(path: Path) -> None:
    assert not {name for name in imported(path) if name.split(".")[0] in ("bpy", "mathutils") or name.startswith("seeing_wind.ui")}


@pytest.mark.parametrize("name", GROUND)
def test_the_ground_floor_needs_numpy_only(name: str) -> None:
    names = imported(PACKAGE / "engine" / f"{name}.py")
    assert not {found for found in names if found.split(".")[0] in HEAVY}
    inside = {found.split(".")[2] for found in names if found.startswith("seeing_wind.engine.") and found.count(".") >= 2}
    assert inside <= set(GROUND)


@pytest.mark.parametrize("path", files(PACKAGE / "ui"), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_the_panel_stands_on_the_ground_floor_only(path: Path) -> None:
    names = imported(path)
    assert not {name for name in names if name.split(".")[0] in HEAVY}
    engine = {name.split(".")[2] for name in names if name.startswith("seeing_wind.engine.")}
    assert engine <= set(GROUND)
    assert not {name for name in names if name.startswith("seeing_wind") and name.split(".")[1:2] not in (["ui"], ["engine"], [])}


@pytest.mark.parametrize("path", files(PACKAGE), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_are_relative(path: Path) -> None:
    """Inside Blender the package has another name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    absolute = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level]
    assert not [node.module for node in absolute if (node.module or "").split(".")[0] == "seeing_wind"]


def test_importing_and_registering_the_panel_loads_nothing_heavy() -> None:
    code = (
        "import sys, seeing_wind.ui as ui; ui.register(); ui._look_round(); ui.unregister(); ui.register();"
        f"print('loaded', sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert "loaded []" in done.stdout, done.stdout + done.stderr
    assert done.returncode == 0, "the process must end by itself, the add-on still switched on"


def test_switching_on_reads_nothing_that_works_on_results() -> None:
    """Blender starts faster by it; the names are those that the package declares as read later."""
    code = (
        "import sys, types, seeing_wind.ui as ui; ui.register(); ui._look_round();"
        "ours = {name for name in sys.modules if name.startswith('seeing_wind') and type(sys.modules[name]) is types.ModuleType};"
        "print('read', *sorted(ours)); ui.unregister()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    read = next(line for line in done.stdout.splitlines() if line.startswith("read ")).split()[1:]
    assert "seeing_wind.ui.panels" in read and not {"seeing_wind.ui.recover.results", "seeing_wind.ui.bake.bake", "seeing_wind.ui.clip.inputs"} & set(read)
    for name in read:
        path = PACKAGE.joinpath(*name.split(".")[1:])
        tree = ast.parse((path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8"))
        top = {alias.name for node in tree.body if isinstance(node, ast.Import) for alias in node.names}
        assert "numpy" not in top, f"{name} imports NumPy, which takes a tenth of a second"

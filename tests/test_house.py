"""The shape of the house: no circles, small rooms, and a map in each."""

from __future__ import annotations

import ast
import graphlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "seeing_wind"
MOST_FILES, MOST_FOLDERS = 12, 7


def name_of(path: Path, root: Path) -> str:
    """The module's name: a package has that of its folder."""
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def graph_of(root: Path, package: str) -> dict[str, set[str]]:
    """Which module imports which, also inside functions and for annotations only. A package's name stands for its `__init__`."""
    modules = {name_of(path, root): path for path in sorted((root / package).rglob("*.py"))}
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        home = name if path.name == "__init__.py" else name.rpartition(".")[0]
        graph[name] = {found for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) for found in named(node, home, modules)}
    return graph


def named(node: ast.AST, package: str, modules: dict[str, Path]) -> set[str]:
    """The modules of ours that one import statement names."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names} & set(modules)
    if not isinstance(node, ast.ImportFrom):
        return set()
    home = ".".join(package.split(".")[: len(package.split(".")) - node.level + 1]) if node.level else ""
    base = ".".join(part for part in (home, node.module or "") if part)
    # `from .room import file` is an arrow to the file, `from .room import name` one to the room's __init__
    return {f"{base}.{alias.name}" if f"{base}.{alias.name}" in modules else base for alias in node.names} & set(modules)


def rooms() -> list[Path]:
    """Every folder of the package that holds code."""
    found = sorted({path.parent for path in PACKAGE.rglob("*.py")})
    assert len(found) > 10
    return found


def test_no_file_imports_itself_round_a_corner() -> None:
    graph = graph_of(ROOT, PACKAGE.name)
    assert len(graph) > 150 and sum(map(len, graph.values())) > 500
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail("a circle of imports: " + " <- ".join(error.args[1]))


@pytest.mark.parametrize("line", ["from .b import thing", "def f():\n    from . import b", "import room.b", "from room.b import thing"])
def test_a_circle_is_seen_wherever_it_hides(line: str, tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    for name, text in (("__init__", ""), ("a", line), ("b", "from .a import other")):
        (tmp_path / "room" / f"{name}.py").write_text(text)
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter(graph_of(tmp_path, "room")).prepare()


def test_no_room_is_crowded() -> None:
    crowded = []
    for room in [*rooms(), *sorted({path.parent for path in (ROOT / "benchmarks").rglob("*.py")})]:
        files = len([path for path in room.glob("*.py") if path.name != "__init__.py"])
        folders = len({path.parent for path in room.glob("*/*.py")})
        if files > MOST_FILES or folders > MOST_FOLDERS:
            crowded.append(f"{room.relative_to(ROOT)}: {files} files, {folders} folders")
    assert not crowded, f"at most {MOST_FILES} files and {MOST_FOLDERS} folders"


def test_every_room_has_a_map_that_names_all_in_it() -> None:
    unnamed = []
    for room in rooms():
        text = ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8"))) or ""
        inside = {path.stem for path in room.glob("*.py") if not path.stem.startswith("__")}
        inside |= {path.parent.name for path in room.glob("*/*.py")}
        missing = sorted(name for name in inside if not re.search(rf"\b{name}\b", text))
        if missing or not text:
            unnamed.append(f"{room.relative_to(ROOT)}/__init__.py says nothing of {', '.join(missing) or 'what it is'}")
    assert not unnamed


def test_a_quantity_is_told_by_in_units() -> None:
    told = re.compile(r":(\.\d)?g\} ?(Pa|mm|kg|m²|m³|kg/m²|N m|m)(?![\w/²³])")
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for line in path.read_text(encoding="utf-8").splitlines()
        if told.search(line)
    ]
    assert not found, "0.00112 kg and 2e+07 Pa are no words for a person: " + "; ".join(found)

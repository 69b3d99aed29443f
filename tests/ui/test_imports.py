"""What programs outside the package import from it is there: they run in Blender or for hours, so a wrong name would be met late."""

import ast
import importlib
import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("sample_scenes", "benchmarks", "scripts", "docs", "tests/blender")
PROGRAMS = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_program_imports_is_there(program):
    nodes = [node for node in ast.walk(ast.parse(program.read_text(encoding="utf-8"))) if isinstance(node, ast.ImportFrom)]
    wanted = [(node.module, name.name) for node in nodes if (node.module or "").startswith("seeing_wind") for name in node.names]
    assert [f"{module}.{name}" for module, name in wanted if not there(module, name)] == []


def there(module: str, name: str) -> bool:
    """Whether a module has this name or holds a module that is called so."""
    return hasattr(importlib.import_module(module), name) or importlib.util.find_spec(f"{module}.{name}") is not None

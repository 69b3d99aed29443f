"""The door to the compiler: the only one, its choice, and what it changes and puts back."""

from __future__ import annotations

import ast
import inspect
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.mpm.compiler import NAMES, choice, default_real, device, settings, ti, tracing

ROOT = Path(__file__).resolve().parents[3]
PRIVATE = {"_runtime", "lang", "get_runtime", "_primal"}


@pytest.mark.parametrize("path", sorted((ROOT / "seeing_wind").rglob("*.py")), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_nobody_else_imports_a_compiler_or_uses_what_it_keeps_private(path):
    if path.parent == ROOT / "seeing_wind/engine/mpm/compiler":
        return
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, (ast.Import, ast.ImportFrom)) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert not {name.split(".")[0] for name in names} & set(NAMES)
        assert not (isinstance(node, ast.Attribute) and node.attr in PRIVATE), f"line {node.lineno}"


def test_the_environment_chooses(monkeypatch):
    for name in NAMES:
        monkeypatch.setenv(choice.VARIABLE, name)
        assert choice.chosen() == name
    monkeypatch.setenv(choice.VARIABLE, "")
    assert choice.chosen() == choice.DEFAULT
    monkeypatch.delenv(choice.VARIABLE)
    assert choice.chosen() == choice.DEFAULT
    monkeypatch.setenv(choice.VARIABLE, "abacus")
    with pytest.raises(UsageError, match="abacus"):
        choice.chosen()


def test_the_worker_says_that_there_is_no_such_compiler(tmp_path):
    command = [sys.executable, "-m", "seeing_wind.engine", "resimulate", "none.take", "--edit", "none.toml", "--take", tmp_path / "o.take"]
    environment = {**os.environ, choice.VARIABLE: "abacus"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    said = json.loads(done.stdout.splitlines()[0])
    assert done.returncode == 2 and said["message"] == "There is no compiler 'abacus'." and "taichi or quadrants" in said["hint"]


def test_frames_have_their_source_again_after_the_import_also_after_an_error():
    with pytest.raises(ZeroDivisionError), tracing.declared_outside_classes():
        here = inspect.getframeinfo(sys._getframe())
        assert here.filename == __file__ and here.code_context == [""]
        raise ZeroDivisionError
    assert "code_context" in inspect.getframeinfo(sys._getframe()).code_context[0]


def test_a_wrong_kernel_is_told_with_its_place():
    @ti.kernel
    def wrong():
        print(1.0 + unknown)  # noqa: F821

    device.start()
    place = rf'File "{Path(__file__)}", line \d+, in wrong:\n +print\(1\.0 \+ unknown\)(.|\n)*Name "unknown" is not defined'
    with pytest.raises(Exception, match=place):  # of the compiler's own kind, which each calls otherwise
        wrong()


def test_precision_and_settings_are_put_back_also_after_an_error():
    device.start()

    def now():
        return default_real(), ti.cfg.fast_math, ti.cfg.real_matrix_scalarize, ti.cfg.opt_level, ti.cfg.cache_loop_invariant_global_vars

    before = now()
    with pytest.raises(ZeroDivisionError), settings.compiled_in(np.float32), settings.contracted(), settings.native_vectors():
        with settings.compiled_sooner():
            assert now() == (ti.f32, True, False, 0, False)
            raise ZeroDivisionError
    assert now() == before == (ti.f64, False, True, 1, True)

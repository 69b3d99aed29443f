"""A whole quick recovery at the lowest and at the newest versions that seeing_wind/engine/requirements.txt admits.

    python scripts/recover_matrix.py --clip CLIP [--python PYTHON]... [--versions lowest newest] [--out build/matrix] [--strict]

For each PYTHON (default: those of 3.11 and 3.13 that are there) uv works out the versions, an environment is made, and CLIP, a folder that
sample_scenes/falling_leaf/make.py made, is recovered. An environment that an earlier run made of the same versions is used again. PyTorch
is always a CPU build: the wanted version from PyTorch's own index; where that cannot be reached, the one that pip finds elsewhere
(PIP_FIND_LINKS). What cannot be run here is skipped, and said; --strict fails.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from environments import ENGINE, IMPORTS, ROOT, executable, install_torch, make, pip  # noqa: E402
from quick_recover import Failed, recover  # noqa: E402

PYTHONS = ("3.11", "3.13")
RESOLUTIONS = {"lowest": "lowest-direct", "newest": "highest"}
NOT_TORCH = re.compile(r"(?!torch==|triton==|nvidia-|cuda-)")
"""Matches the requirements other than PyTorch and the libraries of its CUDA build."""


class Skipped(RuntimeError):
    """Something needed is not available on this machine."""


def main(argv: list[str]) -> int:
    """Run all combinations; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clip", type=Path, required=True)
    parser.add_argument("--python", action="append", metavar="PYTHON")
    parser.add_argument("--versions", nargs="+", choices=RESOLUTIONS, default=list(RESOLUTIONS))
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "matrix")
    parser.add_argument("--strict", action="store_true", help="what is skipped counts as failed")
    options = parser.parse_args(argv)
    bad = 0
    for python, version in found(options.python):
        for versions in options.versions:
            title = f"Python {version}, {versions} versions"
            try:
                if python is None:
                    raise Skipped(f"there is no Python {version} here")
                print(f"{title}: {run(python, versions, options.out / f'{versions}-{version}', options.clip)}", flush=True)
            except Skipped as error:
                print(f"{title}: SKIPPED, {error}", flush=True)
                bad += options.strict
            except Failed as error:
                print(f"{title}: FAILED\n{error}", flush=True)
                bad += 1
            except subprocess.CalledProcessError as error:
                print(f"{title}: FAILED\n{' '.join(map(str, error.cmd[:6]))} ... ended with exit code {error.returncode}", flush=True)
                bad += 1
    return 1 if bad else 0


def found(named: list[str] | None) -> Iterator[tuple[str | None, str]]:
    """The Pythons to run (None for one that is not available), each with its version."""
    for name in named or [f"python{version}" for version in PYTHONS]:
        program = shutil.which(name)
        code = "import sys; print('%d.%d' % sys.version_info[:2])"
        # A version manager may have a stand-in for a Python that is not installed.
        said = subprocess.run([program, "-c", code], capture_output=True, text=True, check=False).stdout.strip() if program else ""
        yield (program, said) if said else (None, name.removeprefix("python"))


def run(python: str, versions: str, out: Path, clip: Path) -> str:
    """Recover in an environment of these versions, made unless it is there; returns what was run.

    Raises:
        Skipped: when there is no CPU build of PyTorch. Failed: when the recovery fails. CalledProcessError: when it cannot be made.
    """
    wanted = resolved(python, versions)
    environment, made = out / "environment", out / "made.json"
    before = json.loads(made.read_text(encoding="utf-8")) if made.is_file() else {}
    note = before.get("note", "")
    if before.get("versions") != wanted:
        shutil.rmtree(out, ignore_errors=True)
        note = install(environment, python, wanted, out / "requirements.txt")
        made.write_text(json.dumps({"versions": wanted, "note": note}) + "\n", encoding="utf-8")
    # One folder of compiled kernels per version of the compiler, which discards those of another version.
    os.environ["TI_OFFLINE_CACHE_FILE_PATH"] = str(out.absolute() / "kernels")
    return recover(str(executable(environment)), out / "take", clip) + note


def install(environment: Path, python: str, wanted: list[str], listed: Path) -> str:
    """Make an environment of the versions `wanted`, which are written to `listed` too; returns a note on PyTorch, see `some_torch`.

    Raises:
        Skipped: when there is no CPU build of PyTorch. CalledProcessError: when it cannot be made.
    """
    make(environment, python)
    torch = next(line.removeprefix("torch==") for line in wanted if line.startswith("torch=="))
    note = some_torch(environment, torch)
    listed.write_text("\n".join(line for line in wanted if NOT_TORCH.match(line)) + "\n", encoding="utf-8")
    pip(environment, "--only-binary", ":all:", "-r", str(listed))
    subprocess.run([executable(environment), "-c", IMPORTS], check=True)
    return note


def resolved(python: str, versions: str) -> list[str]:
    """The versions that uv works out for a Python: lines NAME==VERSION."""
    command = [uv(), "pip", "compile", "--quiet", "--no-annotate", "--no-header", "--only-binary", ":all:", "--python", python]
    command += ["--resolution", RESOLUTIONS[versions], str(ENGINE / "requirements.txt")]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout.decode().split("\n")


def some_torch(environment: Path, version: str) -> str:
    """Install the wanted version of PyTorch, else any that requirements.txt admits; returns a note where it is another.

    Raises:
        Skipped: when there is none.
    """
    try:
        install_torch(environment, version)
        return ""
    except subprocess.CalledProcessError:
        admitted = next(line for line in (ENGINE / "requirements.txt").read_text(encoding="utf-8").split() if line.startswith("torch>"))
    try:
        pip(environment, "--no-deps", "--no-index", admitted)
    except subprocess.CalledProcessError:
        raise Skipped(f"a CPU build of PyTorch {version} cannot be had") from None
    return f" (a CPU build of PyTorch {version} cannot be had)"


def uv() -> str:
    """Path of uv, which resolves versions; it is installed in build/lock."""
    home = ROOT / "build" / "lock"
    if not executable(home).is_file():
        make(home)
        pip(home, "uv>=0.9,<1")
    return str(executable(home).with_name("uv.exe" if sys.platform == "win32" else "uv"))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

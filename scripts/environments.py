"""Makes the two environments beside Blender's, with any Python 3.11 to 3.13 and on every system.

    python scripts/environments.py engine FOLDER          the engine's, exactly as locked and without bpy, as Install Engine makes it
    python scripts/environments.py tests FOLDER ENGINE    the tests' tools, locked too, over the environment ENGINE, which stays as it is
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ENGINE = ROOT / "seeing_wind" / "engine"
CPU_BUILDS = "https://download.pytorch.org/whl/cpu"
"""PyTorch's own index. On Linux the package index has only the build with CUDA, several GB."""
IMPORTS = "import cv2, matplotlib, networkx, numpy, safetensors, scipy, taichi, torch, trimesh"


def main(argv: list[str]) -> int:
    """Make one of the environments; returns the exit code."""
    try:
        if len(argv) == 2 and argv[0] == "engine":
            make_engine(Path(argv[1]))
        elif len(argv) == 3 and argv[0] == "tests":
            make_tests(Path(argv[1]), Path(argv[2]))
        else:
            print(__doc__, file=sys.stderr)
            return 2
    except subprocess.CalledProcessError as error:
        print(f"{' '.join(map(str, error.cmd[:8]))} ... failed with exit code {error.returncode}", file=sys.stderr)
        return 1
    return 0


def make_engine(folder: Path) -> None:
    """Make the engine's environment: the locked packages and nothing else."""
    make(folder)
    lock = (ENGINE / "torch.lock").read_text(encoding="utf-8").split()
    install_torch(folder, lock[-1].removeprefix("torch=="))
    pip(folder, "--require-hashes", "-r", str(ENGINE / "requirements.lock"))
    subprocess.run([executable(folder), "-c", IMPORTS], check=True, stdout=subprocess.DEVNULL)


def make_tests(folder: Path, engine: Path) -> None:
    """Make an environment that sees, besides its own packages, those of ENGINE and this source."""
    if not executable(folder).is_file():
        subprocess.run([executable(engine), "-m", "venv", "--without-pip", folder], check=True)
    theirs, ours = (site_packages(executable(each)) for each in (engine, folder))
    (ours / "engine.pth").write_text(f"{theirs}\n{ROOT}\n", encoding="utf-8")
    pip(folder, "--require-hashes", "-r", str(ROOT / "tests" / "requirements.lock"))
    subprocess.run([executable(folder), "-c", f"{IMPORTS}, pytest"], check=True, stdout=subprocess.DEVNULL)


def make(folder: Path, base: str = sys.executable) -> None:
    """Make a virtual environment with a recent pip, if it does not exist yet."""
    if not executable(folder).is_file():
        subprocess.run([base, "-m", "venv", folder], check=True)
    pip(folder, "--upgrade", "pip")


def install_torch(folder: Path, version: str) -> None:
    """Install the CPU build of PyTorch, on macOS the only one, without its dependencies, which are locked with the other packages."""
    if sys.platform == "darwin":
        pip(folder, "--no-deps", f"torch=={version}")
    else:
        pip(folder, "--no-deps", "--only-binary", ":all:", "--extra-index-url", CPU_BUILDS, f"torch=={version}+cpu")


def pip(folder: Path, *options: str) -> None:
    """Install by pip."""
    subprocess.run([executable(folder), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *options], check=True)


def executable(folder: Path) -> Path:
    """The Python of a virtual environment."""
    return folder.absolute() / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def site_packages(python: Path) -> Path:
    """The folder of packages of the environment of `python`."""
    said = subprocess.run([python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], check=True, stdout=subprocess.PIPE)
    return Path(said.stdout.decode().strip())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

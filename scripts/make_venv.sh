#!/usr/bin/env bash
# Makes the environment of the engine and of the tests: make_venv.sh FOLDER
# Needs a Python 3.11 or 3.13 (PYTHON=... to choose one): the bpy wheels exist for these two.
set -euo pipefail
venv=$1

usable() { "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 13)))' 2>/dev/null; }

python=
for candidate in ${PYTHON:+"$PYTHON"} python3.11 python3.13 python3 python; do
  if command -v "$candidate" >/dev/null 2>&1 && usable "$candidate"; then python=$candidate; break; fi
done
if [ -z "$python" ]; then
  echo "No Python 3.11 or 3.13 with venv was found." >&2
  echo "Install one (Debian, Ubuntu: apt install python3.11 python3.11-venv; macOS: brew install python@3.11;" >&2
  echo "elsewhere: uv python install 3.11), or name yours: make setup PYTHON=/path/to/python3.11" >&2
  exit 1
fi
echo "Using $("$python" --version) to make $venv (a few minutes: PyTorch, Taichi and Blender's bpy are large)"
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --upgrade pip
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -e ".[blender,test]"
"$venv/bin/python" -c 'import numpy, torch, taichi, cv2' >/dev/null

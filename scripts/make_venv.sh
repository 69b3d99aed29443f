#!/usr/bin/env bash
# Makes the environment of all that needs Blender's bpy: make_venv.sh FOLDER
# Needs a Python 3.11 or 3.13 (PYTHON=... to choose one): the bpy wheels exist for these two.
set -euo pipefail
venv=$1
python=$(bash "$(dirname "$0")/find_python.sh" 3.11 3.13)
echo "Using $("$python" --version) to make $venv (a few minutes: PyTorch, Taichi and Blender's bpy are large)"
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --upgrade pip
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -e ".[blender,test]"
"$venv/bin/python" -c 'import numpy, torch, taichi, cv2' >/dev/null

#!/usr/bin/env bash
# Makes the engine's own environment exactly as locked, without bpy: make_engine_venv.sh FOLDER. PYTHON=... chooses a Python 3.11 to 3.13.
set -euo pipefail
venv=$1
engine=$(dirname "$0")/../seeing_wind/engine
python=${PYTHON:-python3.11}
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
pip=("$venv/bin/python" -m pip install --quiet --disable-pip-version-check)
"${pip[@]}" --upgrade pip
"${pip[@]}" --no-deps -r "$engine/torch.lock"
"${pip[@]}" --require-hashes -r "$engine/requirements.lock"
"$venv/bin/python" -c 'import numpy, torch, taichi, cv2, safetensors, trimesh, matplotlib' >/dev/null

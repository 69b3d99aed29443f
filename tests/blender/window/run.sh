#!/bin/bash
# Runs drive.py in a Blender with a window, then preferences.py with the extension installed from its zip. Needs a screen: with none, run it under xvfb-run.
# usage: run.sh BLENDER_EXECUTABLE [Blender's arguments, such as --gpu-backend opengl]
#        SEEING_WIND_REAL and SEEING_WIND_SCENE let it cancel and resume a real recovery too, see drive.py
#        PYTHON names the Python that makes the test's clip (default: .venv/bin/python)
set -euo pipefail
blender=${1:?usage: run.sh BLENDER_EXECUTABLE [arguments]}
shift
root=$(cd "$(dirname "$0")/../../.." && pwd -P)
python=${PYTHON:-$root/.venv/bin/python}
cd "$root"
work=$(mktemp -d /tmp/seeing_wind_window.XXXXXX)
trap 'rm -rf "$work"' EXIT
"$python" - "$work" <<'PY'
import runpy, sys
from pathlib import Path
tools = runpy.run_path("tests/ui/extension.py")
tools["make_clip"](Path(sys.argv[1]) / "clip.mp4")
tools["fake_python"](Path(sys.argv[1]))
PY
export SEEING_WIND_PYTHON=$work/fake_python SEEING_WIND_CLIP=$work/clip.mp4 LIBGL_ALWAYS_SOFTWARE=${LIBGL_ALWAYS_SOFTWARE:-1}
timeout 900 "$blender" --factory-startup --enable-event-simulate -p 0 0 1280 800 "$@" --python "$root/tests/blender/window/drive.py"

echo "-- Preferences > Add-ons"
export BLENDER_USER_RESOURCES=$work/user
mkdir -p "$BLENDER_USER_RESOURCES"
"$blender" --command extension build --source-dir "$root" --output-filepath "$work/seeing_wind.zip"
"$blender" --command extension install-file -r user_default -e "$work/seeing_wind.zip"
timeout 300 "$blender" -p 0 0 1280 800 "$@" --python "$root/tests/blender/window/preferences.py"

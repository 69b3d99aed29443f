#!/bin/bash
# Takes the pictures of the panel: make.sh BLENDER [STATE or FOLDER ...], with a screen of 1600 x 1000 (with none, under xvfb-run) and
# ImageMagick, whose `import` photographs it. All go into build/screenshots; those that the guide shows are cut out and put here.
# A job that runs, was cancelled or failed is a stand-in for the engine; the rest is the whole job on what `make scenes` left in
# build/scenes. BLENDER_ARGUMENTS= are added, such as --gpu-backend opengl.
set -euo pipefail
blender=$(realpath "${1:?usage: make.sh BLENDER [STATE or FOLDER ...]}")
shift
here=$(cd "$(dirname "$0")" && pwd -P)
root=$(cd "$here/../.." && pwd -P)
python=${PYTHON:-$root/.venv/bin/python}
cd "$root"
work=$(mktemp -d /tmp/seeing_wind.XXXXXX)
trap 'rm -rf "$work"' EXIT
"$python" - "$work" <<'PY'
import runpy, sys
from pathlib import Path
tools = runpy.run_path("tests/ui/extension.py")
tools["make_clip"](Path(sys.argv[1]) / "leaf.mp4")
tools["fake_python"](Path(sys.argv[1]))
PY
export SEEING_WIND_CLIP=$work/leaf.mp4 SEEING_WIND_PICTURES=$root/build/screenshots BLENDER_USER_RESOURCES=$work/user
export LIBGL_ALWAYS_SOFTWARE=${LIBGL_ALWAYS_SOFTWARE:-1}
mkdir -p "$work/user" "$SEEING_WIND_PICTURES"
engine=${SEEING_WIND_PYTHON:-$root/.venv-engine/bin/python}
[ $# -gt 0 ] || set -- running cancelled resumed failed build/scenes/{falling_leaf,flag,potted_plant}
for shot in "$@"; do
  if [ -d "$shot" ]; then shot=$(realpath "$shot") SEEING_WIND_PYTHON=$engine; else SEEING_WIND_PYTHON=$work/fake_python; fi
  export SEEING_WIND_SHOT=$shot SEEING_WIND_PYTHON
  # shellcheck disable=SC2086
  timeout 1800 "$blender" --factory-startup -p 0 0 1600 1000 ${BLENDER_ARGUMENTS:-} --python "$here/make.py" >"$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }
  if grep -E -A8 "Traceback|Error:" "$work/log" >&2; then exit 1; fi
  grep "^screenshot" "$work/log"
done
"$python" "$here/crop.py" "$SEEING_WIND_PICTURES" "$here"

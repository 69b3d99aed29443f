#!/bin/bash
# Takes the pictures of the panel: make.sh SHOOT, where `SHOOT OUT.png SECONDS [blender arguments...]` shows Blender's window on some screen
# and writes a picture of it after SECONDS. The engine is the stand-in of the tests, so that every state comes up at once; `done` and `field`
# show what `make scenes` left in build/scenes/falling_leaf.
set -euo pipefail
shoot=$(realpath "${1:?usage: make.sh SHOOT [STATE...]}")
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
export SEEING_WIND_JOB=${SEEING_WIND_JOB:-$root/build/scenes/falling_leaf/job.blend}
export SEEING_WIND_PYTHON=$work/fake_python SEEING_WIND_CLIP=$work/leaf.mp4 BLENDER_USER_RESOURCES=$work/user
mkdir -p "$work/user"
[ $# -gt 0 ] || set -- idle running cancelled resumed failed done field
for state in "$@"; do
  SEEING_WIND_SHOT=$state "$shoot" "$work/$state.png" "$(case $state in done | field) echo "${LONG:-26}" ;; idle) echo 14 ;; *) echo "${LONG:-26}" ;; esac)" --factory-startup --python "$here/make.py" >"$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }
  grep -E "Traceback|Error:" "$work/log" >&2 || true
  "$python" "$here/crop.py" "$work/$state.png" "$here/$state.png"
  echo "docs/screenshots/$state.png"
done

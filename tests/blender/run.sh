#!/bin/bash
# Builds the extension, validates it, installs it into a Blender with settings of its own, and drives it there. Fails if any of it fails.
# usage: run.sh BLENDER_EXECUTABLE        PYTHON names the Python that makes the test's clip (default: .venv/bin/python)
set -euo pipefail
blender=${1:?usage: run.sh BLENDER_EXECUTABLE}
root=$(cd "$(dirname "$0")/../.." && pwd -P)
python=${PYTHON:-$root/.venv/bin/python}
cd "$root"
work=$(mktemp -d /tmp/seeing_wind_blender.XXXXXX)
trap 'rm -rf "$work"' EXIT
export BLENDER_USER_RESOURCES=$work/user SEEING_WIND_FAKE_SECONDS=0.1
mkdir -p "$BLENDER_USER_RESOURCES"

"$python" - "$work" <<'PY'
import runpy, sys
from pathlib import Path
tools = runpy.run_path("tests/ui/extension.py")
tools["make_clip"](Path(sys.argv[1]) / "clip.mp4")
tools["fake_python"](Path(sys.argv[1]))
PY
export SEEING_WIND_PYTHON=$work/fake_python SEEING_WIND_CLIP=$work/clip.mp4

echo "-- build and validate"
"$blender" --command extension build --source-dir "$root" --output-filepath "$work/seeing_wind.zip"
"$blender" --command extension validate "$work/seeing_wind.zip"
"$python" tests/blender/check_zip.py "$work/seeing_wind.zip"

echo "-- install and drive"
# The exit code of install-file says nothing; drive_extension.py fails if it did not work.
"$blender" --command extension install-file -r user_default -e "$work/seeing_wind.zip"
"$blender" -b --python-exit-code 9 --python "$root/tests/blender/drive_extension.py"
# It walks all modules that are loaded, as Preferences > Add-ons does.
"$blender" --command extension list 2>&1 | tee "$work/list"
grep -q "seeing_wind" "$work/list" && ! grep -q Traceback "$work/list" || { echo "extension list failed" >&2; exit 1; }

echo "-- the field object, bakes and exports"
"$blender" -b --factory-startup --python-exit-code 9 --python "$root/tests/blender/field_object_check.py"

echo "-- Blender's own solvers in the field"
"$blender" -b --factory-startup --python-exit-code 9 --python "$root/tests/blender/native_solvers_check.py"

echo "-- cloth and particles in a wind"
"$blender" -b --factory-startup --python-exit-code 9 --python "$root/tests/blender/wind_check.py"

echo "-- Blender's own force fields in a re-simulation"
"$blender" -b --factory-startup --python-exit-code 9 --python "$root/tests/blender/force_fields_check.py"

echo "-- calibration, composite and VDB"
"$blender" -b --factory-startup --python-exit-code 9 --python "$root/tests/blender/composite_check.py"

echo "-- commands"
expect() { local code=0; "$blender" --command seeing_wind "${@:2}" || code=$?; [ "$code" = "$1" ] || { echo "seeing_wind ${*:2}: exit code $code instead of $1" >&2; exit 1; }; }
expect 0 recover "$SEEING_WIND_CLIP" --take "$work/out.take" --box 20 20 44 44 --save "$work/out.blend"
[ -s "$work/out.blend" ] || { echo "recover --save wrote no file" >&2; exit 1; }
expect 2 fly
SEEING_WIND_FAKE=die expect 1 recover "$SEEING_WIND_CLIP" --take "$work/died.take" --box 20 20 44 44

echo "-- removed"
"$blender" -b --python-exit-code 9 --python "$root/tests/blender/remove_extension.py"
echo "-- the extension works in $("$blender" --version | head -1)"

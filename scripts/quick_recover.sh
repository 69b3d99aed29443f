#!/usr/bin/env bash
# A whole recovery of a short clip by the given Python: quick_recover.sh PYTHON FOLDER. Fails unless every file of the take is there.
set -euo pipefail
python=$(realpath -s "$1") out=$2
cd "$(dirname "$0")/.."
rm -rf "$out"
# The clip is made in the tests' environment, which has the default compiler only.
env -u SEEING_WIND_COMPILER .venv/bin/python sample_scenes/falling_leaf/make.py --out "$out/clip" --frames 10 --size 320x180 --samples 4
if "$python" -c 'import bpy' 2>/dev/null; then echo "$1 has bpy: it is not the engine's own environment." >&2; exit 1; fi
"$python" -m seeing_wind.engine recover "$out/clip/clip.mp4" --take "$out/wind.take" --mask "$out/clip/mask_0000.png" \
  --camera "$out/clip/camera.json" --distance 2 --material leaf --particles 200 >"$out/log.jsonl" 2>"$out/log.txt" \
  || { tail -n 3 "$out/log.jsonl" "$out/log.txt" >&2; exit 1; }
for file in field.safetensors trajectory.npz report.json report.png overlay.mp4; do
  [ -s "$out/wind.take/$file" ] || { echo "The take has no $file." >&2; exit 1; }
done
echo "Recovered in $("$python" -c 'import cv2, numpy, torch; print("NumPy", numpy.__version__, "OpenCV", cv2.__version__, "PyTorch", torch.__version__)')"

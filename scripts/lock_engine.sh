#!/usr/bin/env bash
# Writes seeing_wind/engine/requirements.lock anew: exact versions and hashes for Python 3.11 to 3.13 on Linux, macOS and Windows.
#
# PyTorch stands apart, in torch.lock: on Linux the package index has its CUDA build only, which brings several GB of libraries, and the
# CPU build comes from PyTorch's own index under the same version but with other hashes. What PyTorch needs besides CUDA is in the first.
set -euo pipefail
cd "$(dirname "$0")/.."
tool=build/lock
[ -x "$tool/bin/uv" ] || { "${PYTHON:-python3.11}" -m venv "$tool"; "$tool/bin/python" -m pip install --quiet --disable-pip-version-check uv; }
out=seeing_wind/engine
trap 'rm -f "$out"/.*.part' EXIT
compile() { "$tool/bin/uv" pip compile --quiet --universal --python-version 3.11 --no-annotate --no-header "$@"; }

compile --generate-hashes "$out/requirements.txt" -o "$out/.all.part" >/dev/null
cuda=$(grep -oE '^(torch|triton|nvidia-[a-z0-9-]+|cuda-[a-z0-9-]+)==' "$out/.all.part" | tr -d '=')
without=()
for name in $cuda; do without+=(--no-emit-package "$name"); done
compile --generate-hashes "${without[@]}" "$out/requirements.txt" -o "$out/.lock.part" >/dev/null
compile "$out/requirements.txt" | grep -E '^torch==' >"$out/.torch.part"
{ echo "# Written by scripts/lock_engine.sh (make lock) from requirements.txt; PyTorch itself is in torch.lock."; grep -vE '^ +# ' "$out/.lock.part" | grep -v '^#'; } >"$out/.final.part"
mv "$out/.final.part" "$out/requirements.lock"
{ echo "# Written by scripts/lock_engine.sh (make lock). No hash: it differs between the builds; pip checks that of the index."; cat "$out/.torch.part"; } >"$out/.t2.part"
mv "$out/.t2.part" "$out/torch.lock"

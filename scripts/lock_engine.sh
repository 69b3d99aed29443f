#!/usr/bin/env bash
# Writes seeing_wind/engine/requirements.lock anew: exact versions and hashes for Python 3.11 to 3.13 on Linux, macOS and Windows. Then
# tests/requirements.lock: the tests' tools (pyproject.toml, extra `test`) at versions that go with it, and without what is in it.
#
# PyTorch stands apart, in torch.lock: on Linux the package index has its CUDA build only, which brings several GB of libraries, and the
# CPU build comes from PyTorch's own index under the same version but with other hashes. What PyTorch needs besides CUDA is in the first.
set -euo pipefail
cd "$(dirname "$0")/.."
tool=build/lock
python=$(bash scripts/find_python.sh 3.11 3.12 3.13)
[ -x "$tool/bin/uv" ] || { "$python" -m venv "$tool"; "$tool/bin/python" -m pip install --quiet --disable-pip-version-check 'uv>=0.9,<1'; }
out=seeing_wind/engine
trap 'rm -f "$out"/.*.part tests/.*.part' EXIT
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

"$python" -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["test"], sep="\n")' >tests/.in.part
without=()
for name in $(grep -oE '^[a-z0-9-]+==' "$out/requirements.lock" | tr -d '=' | sort -u) $cuda; do without+=(--no-emit-package "$name"); done
compile --generate-hashes -c "$out/requirements.lock" "${without[@]}" tests/.in.part -o tests/.lock.part >/dev/null
{ echo "# Written by scripts/lock_engine.sh (make lock): the tests' tools, over seeing_wind/engine/requirements.lock."; grep -vE '^ *#' tests/.lock.part; } >tests/.final.part
mv tests/.final.part tests/requirements.lock

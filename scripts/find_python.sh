#!/usr/bin/env bash
# Prints a Python of one of the given versions that can make environments: find_python.sh 3.11 3.13. PYTHON=... is looked at first.
set -euo pipefail

usable() { "$1" -c 'import sys, venv, ensurepip; sys.exit("%d.%d" % sys.version_info[:2] not in sys.argv[1:])' "${@:2}" 2>/dev/null; }

for candidate in ${PYTHON:+"$PYTHON"} "${@/#/python}" python3 python; do
  if command -v "$candidate" >/dev/null 2>&1 && usable "$candidate" "$@"; then command -v "$candidate"; exit; fi
done
echo "No Python $* with venv was found." >&2
echo "Install one (Debian, Ubuntu: apt install python3.11 python3.11-venv; macOS: brew install python@3.11;" >&2
echo "elsewhere: uv python install 3.11), or name yours: make setup PYTHON=/path/to/python3.11" >&2
exit 1

# What .ci/run and .ci/nightly share; sourced by them.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
shared=../shared
# The solver's kernels are compiled once for all steps, and kept for the next run; `make` has the same folder.
export TI_OFFLINE_CACHE_FILE_PATH=$PWD/build/kernels

times=()
# begin TITLE: the step before has ended; what each took is printed at the end.
begin() {
  times+=("$SECONDS $1")
  echo "== $1"
}

# finish: the table of what each step took.
finish() {
  times+=("$SECONDS end")
  for ((i = 0; i + 1 < ${#times[@]}; i++)); do
    printf '%5d s  %s\n' $((${times[i + 1]%% *} - ${times[i]%% *})) "${times[i]#* }"
  done
  echo "All of $0 passed in $SECONDS s"
}

# find_blender: BLENDER is set where there is one, to a real one if one can be had.
find_blender() {
  if [ -z "${BLENDER:-}" ] && [ -x "$shared/blender/get_blender.sh" ]; then
    "$shared/blender/get_blender.sh" >/dev/null
    # A folder bound into that Blender by an earlier run, deleted since and made anew, would look empty inside: let go of it.
    awk '$4 ~ /\/\/deleted$/ {print $5}' /proc/self/mountinfo | xargs -r -n 1 umount --lazy
    BLENDER=$(realpath "$shared/blender/blender")
  fi
  BLENDER=${BLENDER:-$(command -v blender || true)}
}

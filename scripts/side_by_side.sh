#!/usr/bin/env bash
# Makes the example's captures, then the results of each fitted and of each predicted sequence, as many side by side as there are cores, among which they are shared out:
# two stages on a core each are done sooner than one after the other on both. `dvc repro` afterwards does what is left.
set -euo pipefail
cd "$(dirname "$0")/.."

# one_target [options of dvc repro] TARGET: waits where another target is at a file that both need, as the networks, which DVC takes for an error
one_target() {
  local log status
  log=$(mktemp)
  while true; do
    dvc --wait-for-lock repro "$@" 2>&1 | tee "$log" | { grep --line-buffered -v -E "^(Stage '|ERROR: .*is busy|  \(PID |If there are no processes|$)" || true; }
    status=${PIPESTATUS[0]}
    grep -q "is busy" "$log" || break
    sleep 5
  done
  rm "$log"
  [ "$status" = 0 ]
}
export -f one_target

# side_by_side TARGETS [options of dvc repro]; a target a line
side_by_side() {
  local targets=$1 cores jobs
  shift
  cores=$(nproc)
  jobs=$(wc -l <<<"$targets")
  PHYSREAL_CORES=$((cores > jobs ? cores / jobs : 1)) \
    xargs -P "$cores" -I '{}' bash -c 'one_target "$@"' one_target "$@" '{}' <<<"$targets"
}

side_by_side "$(dvc stage list pipeline/rig/dvc.yaml --name-only)" --single-item
side_by_side "$(printf 'pipeline/evaluate/dvc.yaml:evaluate@%s\n' bar_lift plush_lift plain_lift)" # the longest first
side_by_side "$(dvc stage list pipeline/evaluate/dvc.yaml --name-only)"

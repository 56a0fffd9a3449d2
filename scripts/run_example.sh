#!/usr/bin/env bash
# The main job on the embedded example: installs what is missing, runs `dvc repro`, says where the report is.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/install.sh --models
[ $# -gt 0 ] || scripts/side_by_side.sh
dvc repro "$@"
physreal status

#!/usr/bin/env bash
# Installs what is missing and runs the tests. Arguments go to pytest: scripts/test.sh -m "slow or not slow" runs the long ones too.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/install.sh --no-models
physreal models viperx || echo "no robot arm: its tests are skipped"
python -m pytest "$@"

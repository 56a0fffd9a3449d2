#!/usr/bin/env bash
# Films the example's captures side by side: each keeps one core busy. `dvc repro` would film one after another.
set -euo pipefail
cd "$(dirname "$0")/.."
dvc stage list pipeline/rig/dvc.yaml --name-only |
  xargs -P "$(nproc)" -I '{}' dvc --wait-for-lock repro --quiet --single-item '{}'

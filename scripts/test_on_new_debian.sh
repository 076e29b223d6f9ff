#!/usr/bin/env bash
# test_on_new_debian.sh [FOLDER] [PYTEST OPTIONS …]: the plugin in the real window of a newer QGIS (tests/desktop).
# FOLDER (default build/trixie, 3 GB) becomes a Debian 13 by debootstrap, with its QGIS 3.40, Python 3.13, NumPy 2 and
# GDAL 3.10 and no packages of pip; it is used again the next time. Needs Debian, root, and debootstrap. Pictures go to
# build/desktop-new.
set -euo pipefail
cd "$(dirname "$0")/.."
readonly SUITE=trixie
FOLDER=$(realpath -m "${1:-build/$SUITE}"); readonly FOLDER
shift || true
readonly PACKAGES="qgis python3-qgis python3-gdal python3-numpy python3-scipy python3-shapely python3-pyproj python3-jinja2
  python3-opencv python3-numba python3-pytest python3-hypothesis xvfb libxtst6 git ca-certificates fonts-dejavu-core"

inside() {
  chroot "$FOLDER" /usr/bin/env -i HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive OPENBLAS_NUM_THREADS=1 \
    PATH=/usr/sbin:/usr/bin:/sbin:/bin PYTHONPATH=/root/work PYTHONDONTWRITEBYTECODE=1 bash -c "$1"
}

command -v debootstrap >/dev/null || { echo "install debootstrap" >&2; exit 2; }
if [ ! -e "$FOLDER/usr/bin/apt-get" ]; then
  sources=$(cat /etc/apt/sources.list.d/debian.sources /etc/apt/sources.list 2>/dev/null || true)
  address=$(grep -oE 'https?://[^ ]+/debian/?( |$)' <<<"$sources" | head -1) || true
  debootstrap --variant=minbase "$SUITE" "$FOLDER" ${address:-http://deb.debian.org/debian}
fi
trap 'umount -l "$FOLDER/dev" "$FOLDER/proc" 2>/dev/null || true' EXIT
mountpoint -q "$FOLDER/proc" || mount -t proc proc "$FOLDER/proc"
mountpoint -q "$FOLDER/dev" || { mount --rbind /dev "$FOLDER/dev" && mount --make-rslave "$FOLDER/dev"; }
cp /etc/resolv.conf "$FOLDER/etc/resolv.conf"
mkdir -p "$FOLDER/etc/ssl/certs" && cp /etc/ssl/certs/ca-certificates.crt "$FOLDER/etc/ssl/certs/"
# shellcheck disable=SC2086 # the words of the list
inside "dpkg -s ${PACKAGES//$'\n'/ } >/dev/null 2>&1 || { apt-get update -q && apt-get install -y -q --no-install-recommends ${PACKAGES//$'\n'/ }; }"
rm -rf "$FOLDER/root/work" && mkdir -p "$FOLDER/root/work/hrsi"
git ls-files -z | tar --null --files-from=- --create | tar --extract --directory="$FOLDER/root/work/hrsi"
status=0
inside "cd /root/work/hrsi && qgis --version 2>/dev/null; python3 -m pytest -p no:cacheprovider $(printf '%q ' "${@:-tests/desktop}")" || status=$?
rm -rf build/desktop-new
[ ! -d "$FOLDER/root/work/hrsi/build/desktop" ] || cp -r "$FOLDER/root/work/hrsi/build/desktop" build/desktop-new
exit $status

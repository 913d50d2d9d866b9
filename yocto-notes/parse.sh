#!/bin/sh
# SPDX-License-Identifier: MIT
# Parses the layer with bitbake, then resolves every dependency of the image; builds nothing.
#   yocto-notes/parse.sh [MACHINE]      qemux86-64 (default) or raspberrypi4-64; fetches the layers it needs with kas
# KAS_WORK_DIR is where to (default: yocto-build next to the checkout; about 1 GB of git repositories).
set -eu

refuse() {
    echo "parse.sh: $1" >&2
    exit 2
}

machine=${1:-qemux86-64}
here=$(cd "$(dirname "$0")" && pwd)
file=$here/kas/segway-ecc-$machine.yml

[ -f "$file" ] || refuse "no kas file for $machine: it is qemux86-64 or raspberrypi4-64"
[ "$(id -u)" -ne 0 ] || refuse "bitbake refuses to run as root: run this as an ordinary user"
command -v kas >/dev/null || refuse "kas is missing, which fetches bitbake and the layers: pip install kas"
locale -a 2>/dev/null | grep -qi '^en_US\.utf-\?8$' ||
    refuse "bitbake needs the locale en_US.UTF-8: sudo locale-gen en_US.UTF-8"

KAS_WORK_DIR=${KAS_WORK_DIR:-$here/../../yocto-build}
export KAS_WORK_DIR
mkdir -p "$KAS_WORK_DIR"
[ -f "$KAS_WORK_DIR/authorized_keys" ] ||
    refuse "nobody could log in: put your public ssh key into $KAS_WORK_DIR/authorized_keys"

# -p finds a class that is not there; only -g finds a dependency that nobody provides.
kas shell "$file" --command "bitbake -p && bitbake -g segway-ecc-image"
echo "parse.sh: $machine: every recipe parses, and every dependency of segway-ecc-image is provided"

#!/bin/sh
# SPDX-License-Identifier: MIT
# First process of the user-mode Linux guest that hil/kernels/uml.py boots. The root is the host's, read-only.
# settings.sh (settings), guest.sh (what the guests share) and command.sh (what to run) stand beside this file.
set -eu
export PATH=/usr/sbin:/usr/bin:/sbin:/bin

. "${0%/*}/guest.sh"
trap power_off EXIT
mount -t proc proc /proc
. "${0%/*}/settings.sh"

mount_memory
mount -t hostfs -o "$GUEST_SCRATCH" none "$scratch"

# Through Python, since a host without modules of its own (a container) often has no insmod.
load_modules() {
    "$GUEST_PYTHON" -I -S - "$@" <<'PYTHON'
import ctypes
import os
import sys

FINIT_MODULE = 313  # the system call's number on x86-64, the only processor user-mode Linux is packaged for
libc = ctypes.CDLL(None, use_errno=True)
for path in sys.argv[1:]:
    if os.path.exists(path) and libc.syscall(FINIT_MODULE, os.open(path, os.O_RDONLY), b"", 0):
        sys.exit(f"{path}: {os.strerror(ctypes.get_errno())}")
PYTHON
}
modules="/usr/lib/uml/modules/$(uname -r)/kernel"
can="$modules/net/can"
drivers="$modules/drivers/net/can"
load_modules "$modules/fs/overlayfs/overlay.ko" "$can/can.ko" "$can/can-raw.ko" "$can/can-bcm.ko" "$can/can-gw.ko" \
    "$drivers/dev/can-dev.ko" "$drivers/vcan.ko" "$drivers/vxcan.ko" "$drivers/slcan/slcan.ko"

mount_root /
if [ -n "$GUEST_RESULTS" ]; then
    mount -t hostfs -o "$GUEST_RESULTS" none "$root$GUEST_RESULTS"
fi

echo uml-guest > /proc/sys/kernel/hostname
ip link set lo up
for interface in $GUEST_INTERFACES; do
    ip link add dev "$interface" type vcan
    ip link set "$interface" up
done

run_command

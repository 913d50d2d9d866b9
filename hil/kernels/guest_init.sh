#!/bin/sh
# First process of the user-mode Linux guest that hil/kernels/uml.py boots. The root is the host's, read-only.
# job.sh (settings) and command.sh (what to run) stand beside this file.
set -eu
export PATH=/usr/sbin:/usr/bin:/sbin:/bin

power_off() {
    sync
    # Not halt(8): what it does depends on the host's init system, and a container has none.
    echo o > /proc/sysrq-trigger
    sleep 30
}
trap power_off EXIT

mount -t proc proc /proc
. "${0%/*}/job.sh"

# Everything that is written goes to memory: an overlay over the read-only root.
# On /run, since the scratch folder, the checkout and its interpreter may all be under /tmp.
mount -t tmpfs tmpfs /run
root=/run/root
scratch=/run/scratch
mkdir /run/upper /run/work "$root" "$scratch"
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

mount -t overlay overlay -o lowerdir=/,upperdir=/run/upper,workdir=/run/work "$root"
mount -t proc proc "$root/proc"
mount -t sysfs sysfs "$root/sys"
mount -t devtmpfs devtmpfs "$root/dev"
mkdir -p "$root/dev/pts" "$root/dev/shm"
mount -t devpts -o ptmxmode=666 devpts "$root/dev/pts"
mount -t tmpfs tmpfs "$root/dev/shm"
# The host's sockets and lock files in /run mean nothing here.
mount -t tmpfs tmpfs "$root/run"
mkdir "$root/run/home"
if [ -n "$GUEST_RESULTS" ]; then
    mkdir -p "$root$GUEST_RESULTS"
    mount -t hostfs -o "$GUEST_RESULTS" none "$root$GUEST_RESULTS"
fi

echo uml-guest > /proc/sys/kernel/hostname
ip link set lo up
for interface in $GUEST_INTERFACES; do
    ip link add dev "$interface" type vcan
    ip link set "$interface" up
done

cp "$scratch/command.sh" "$root/run/command.sh"
echo "$GUEST_TOKEN begin"
status=0
chroot "$root" sh /run/command.sh < /dev/null 2>&1 || status=$?
echo "$GUEST_TOKEN end"
echo "$status" > "$scratch/status"

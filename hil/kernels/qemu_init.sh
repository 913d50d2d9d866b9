#!/bin/sh
# SPDX-License-Identifier: MIT
# First process of the guest that hil/kernels/qemu.py boots, in an initramfs with busybox and the modules to load.
# settings.sh (settings) and guest.sh (what the guests share) stand beside this file.
set -eu
export PATH=/bin

/bin/busybox --install -s /bin
. /guest.sh
trap power_off EXIT
mount -t devtmpfs devtmpfs /dev
mount -t proc proc /proc
. /settings.sh

for module in $GUEST_MODULES; do
    insmod "/modules/$module"
done

# mount_host TAG FOLDER [OPTION]: a folder of the host's, by the name that QEMU gave it.
mount_host() {
    mount -t 9p -o "trans=virtio,version=9p2000.L,msize=512000${3:+,$3}" "$1" "$2"
}
mount_memory
mount_host scratch "$scratch"
mkdir /host
# Kept in memory once read: nobody else is to change these while the guest runs.
mount_host host /host ro,cache=loose
mount_root /host
if [ -n "$GUEST_RESULTS" ]; then
    mount_host results "$root$GUEST_RESULTS"
fi

echo rt-guest > /proc/sys/kernel/hostname
# The host's ip, by its path: busybox takes ip alone for its own, which does not know CAN.
ip_link() {
    chroot "$root" /sbin/ip link set "$@"
}
ip_link lo up
set_up() {
    ip_link "$1" type can bitrate "$GUEST_BITRATE" restart-ms 100 && ip_link "$1" txqueuelen 16 && ip_link "$1" up
}
for channel in can0 can1; do
    ip_link "$channel" type can berr-reporting on || echo "$channel: this driver does not report bus errors"
    if ! set_up "$channel"; then
        echo "$channel: could not be set up at $GUEST_BITRATE bit/s"
        exit 1
    fi
done

run_command

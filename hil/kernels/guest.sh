# SPDX-License-Identifier: MIT
# What the first processes of the guests share; each reads this from beside itself, with the settings in settings.sh.
# root is where the command runs: over the host's files, with all that is written kept in memory.
root=/run/root
scratch=/run/scratch

power_off() {
    sync
    # Not halt(8): what it does depends on the host's init system, and a container has none.
    echo o > /proc/sysrq-trigger
    sleep 30
}

# On /run, since the scratch folder, the checkout and its interpreter may all be under /tmp.
mount_memory() {
    mount -t tmpfs tmpfs /run
    mkdir /run/upper /run/work "$root" "$scratch"
}

# mount_root LOWER: the host's files are at LOWER, read-only.
mount_root() {
    mount -t overlay overlay -o "lowerdir=$1,upperdir=/run/upper,workdir=/run/work" "$root"
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
    fi
}

run_command() {
    cp "$scratch/command.sh" "$root/run/command.sh"
    echo "$GUEST_TOKEN begin"
    status=0
    # By its path: a busybox takes sh alone for its own.
    chroot "$root" /bin/sh /run/command.sh < /dev/null 2>&1 || status=$?
    echo "$GUEST_TOKEN end"
    echo "$status" > "$scratch/status"
}

SUMMARY = "The robot: read-only root, a small writable partition, ssh by key only"
DESCRIPTION = "Control node, guard, recorder, ROS 2 and a real-time kernel; the base station is left out."
SECTION = "robotics"
LICENSE = "MIT"

inherit core-image

IMAGE_FEATURES += "\
    overlayfs-etc \
    read-only-rootfs \
    ssh-server-openssh \
"

IMAGE_INSTALL += "\
    can-utils \
    iproute2 \
    kernel-modules \
    segway-ecc \
    segway-ecc-access \
    segway-ecc-canopen \
    segway-ecc-data \
    segway-ecc-ros \
"

# /etc keeps its changes here: the robot file, the host name, ssh's host keys.
OVERLAYFS_ETC_MOUNT_POINT = "/data"
OVERLAYFS_ETC_DEVICE = "LABEL=segway-data"
OVERLAYFS_ETC_FSTYPE = "ext4"

IMAGE_FSTYPES = "wic"
# rpi is what meta-raspberrypi calls all its boards.
# nooelint: oelint.vars.specific
IMAGE_FSTYPES:rpi = "wic.bmap wic.bz2"
WKS_FILE:qemux86-64 = "segway-ecc-qemux86-64.wks"
# nooelint: oelint.vars.specific
WKS_FILE:rpi = "segway-ecc-raspberrypi.wks"

# Checked here because image features come from local.conf as well.
# nooelint: oelint.task.noanonpython
python () {
    weak = {"allow-empty-password", "debug-tweaks", "empty-root-password"} & set(d.getVar("IMAGE_FEATURES").split())
    if weak:
        raise bb.parse.SkipRecipe("a robot without a password is anybody's: remove %s" % ", ".join(sorted(weak)))
}

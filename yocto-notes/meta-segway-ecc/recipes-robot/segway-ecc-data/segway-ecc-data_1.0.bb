SUMMARY = "Keeps the robot's state and logs on the data partition"
DESCRIPTION = "The root is read-only and /var is in memory: this binds the state and log directories to the data partition."
SECTION = "robotics"
LICENSE = "MIT"
# The source lies in this layer, so the licence is the common text.
# nooelint: oelint.var.licenseremotefile
LIC_FILES_CHKSUM = "file://${COMMON_LICENSE_DIR}/MIT;md5=0835ade698e0bcf8506ecda2f7b4f302"

SRC_URI = "\
    file://segway-ecc-data \
    file://segway-ecc-data.service \
"

S = "${WORKDIR}"

inherit allarch systemd

do_install() {
    install -d ${D}/data
    install -d ${D}${libexecdir}
    install -d ${D}${systemd_system_unitdir}
    install -m 0755 ${WORKDIR}/segway-ecc-data ${D}${libexecdir}/segway-ecc-data
    sed -e 's:@LIBEXECDIR@:${libexecdir}:g' \
        ${WORKDIR}/segway-ecc-data.service > ${D}${systemd_system_unitdir}/segway-ecc-data.service
}

FILES:${PN} += "/data"

RDEPENDS:${PN} += "\
    coreutils \
    segway-ecc \
    util-linux-mount \
    util-linux-mountpoint \
"

SYSTEMD_SERVICE:${PN} = "segway-ecc-data.service"

SUMMARY = "The ssh keys that may log in to the robot"
DESCRIPTION = "Installs the public keys of SEGWAY_ECC_AUTHORIZED_KEYS for root. There is no password to log in with."
SECTION = "robotics"
LICENSE = "MIT"
# The source lies in this layer, so the licence is the common text.
# nooelint: oelint.var.licenseremotefile
LIC_FILES_CHKSUM = "file://${COMMON_LICENSE_DIR}/MIT;md5=0835ade698e0bcf8506ecda2f7b4f302"

# A file of one public key a line, named in local.conf or in the kas file.
SEGWAY_ECC_AUTHORIZED_KEYS ?= ""

# Nothing is fetched: the keys are a file of whoever builds.
SRC_URI = ""

S = "${WORKDIR}"

inherit allarch

# Skipped with the reason, so that bitbake reports why the image cannot be built.
# nooelint: oelint.task.noanonpython
python () {
    keys = d.getVar("SEGWAY_ECC_AUTHORIZED_KEYS")
    if not keys or not os.path.isfile(keys):
        raise bb.parse.SkipRecipe(
            "nobody could log in: set SEGWAY_ECC_AUTHORIZED_KEYS to a file of public ssh keys (now: '%s')" % keys
        )
}

# Other keys make another package.
do_install[file-checksums] += "${SEGWAY_ECC_AUTHORIZED_KEYS}:True"

do_install() {
    install -d -m 0700 ${D}${ROOT_HOME}/.ssh
    install -m 0600 ${SEGWAY_ECC_AUTHORIZED_KEYS} ${D}${ROOT_HOME}/.ssh/authorized_keys
}

FILES:${PN} += "${ROOT_HOME}/.ssh"

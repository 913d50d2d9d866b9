SUMMARY = "CANopen in Python, for drives that speak it"
DESCRIPTION = "Object dictionary, SDO, PDO, NMT and CiA 402 on top of python-can."
HOMEPAGE = "https://github.com/canopen-python/canopen"
SECTION = "devel/python"
LICENSE = "MIT"
LIC_FILES_CHKSUM = "file://LICENSE.txt;md5=97f135a6ee6f800c377b5512122c7a8d"

DEPENDS += "python3-setuptools-scm-native"

SRC_URI[sha256sum] = "20a84bc498b34dadd79cece467d3bbe19591c1c02a8f39331bcc6065c4d8b2eb"

inherit pypi python_setuptools_build_meta

RDEPENDS:${PN} += "\
    python3-can \
    python3-modules \
"

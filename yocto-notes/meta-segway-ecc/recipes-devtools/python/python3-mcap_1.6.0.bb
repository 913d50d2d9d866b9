SUMMARY = "Reads and writes MCAP logs"
DESCRIPTION = "The container format of the robot's logs: indexed, compressed, readable after a power cut."
HOMEPAGE = "https://github.com/foxglove/mcap"
SECTION = "devel/python"
LICENSE = "MIT"
# The source distribution holds no licence file: the classifier in setup.cfg names the licence.
LIC_FILES_CHKSUM = "file://setup.cfg;beginline=10;endline=10;md5=9ee0b273d083f81b62454cc785204c39"

SRC_URI[sha256sum] = "d9aa1d9706ada964740536c7598b735a5aab677493d52c2be59fbd7467ec5664"

inherit pypi python_setuptools_build_meta

RDEPENDS:${PN} += "\
    python3-lz4 \
    python3-modules \
    python3-zstandard \
"

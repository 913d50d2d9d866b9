SUMMARY = "Controller Area Network interface module for Python"
DESCRIPTION = "Newer than the one in meta-python, and the newest that this release's setuptools builds."
HOMEPAGE = "https://github.com/hardbyte/python-can"
SECTION = "devel/python"
LICENSE = "LGPL-3.0-only"
LIC_FILES_CHKSUM = "file://LICENSE.txt;md5=e6a600fd5e1d9cbde2d983680233ad02"

SRC_URI[sha256sum] = "1c46c0935f39f7a9c3e76b03249af0580689ebf7a1844195e92f87257f009df5"

inherit pypi python_setuptools_build_meta

PYPI_PACKAGE = "python_can"

RDEPENDS:${PN} += "\
    python3-modules \
    python3-msgpack \
    python3-packaging \
    python3-typing-extensions \
    python3-wrapt \
"

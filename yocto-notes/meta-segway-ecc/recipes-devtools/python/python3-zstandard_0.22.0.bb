SUMMARY = "Zstandard compression for Python"
DESCRIPTION = "Bindings to the Zstandard library, whose source it carries."
HOMEPAGE = "https://github.com/indygreg/python-zstandard"
SECTION = "devel/python"
LICENSE = "BSD-3-Clause"
LIC_FILES_CHKSUM = "file://LICENSE;md5=3ae87c50fd64b6f0942823686871e758"

SRC_URI[sha256sum] = "8226a33c542bcb54cd6bd0a366067b610b41713b64c9abec1bc4533d69f51e70"

# Its pyproject.toml asks for exact versions of setuptools, wheel and cffi; setup.py builds without them.
inherit pypi setuptools3

RDEPENDS:${PN} += "python3-modules"

# SPDX-License-Identifier: MIT
"""The robot's side as one file that its `python3` runs: sent with each request, and kept there for the next boot."""

import importlib.resources
import io
import zipfile
from typing import Final

_PACKAGES: Final = ("segway_ecc", "segway_ecc.deploy", "segway_ecc.deploy.release", "segway_ecc.deploy.release.agent")
_MAIN: Final = """import sys

from segway_ecc.deploy.release.agent.main import main

sys.exit(main(sys.argv[1:]))
"""
_LONG_AGO: Final = (2020, 2, 2, 0, 0, 0)

# Also an old python3 must be able to read this, to report its age. The program stays in memory and leaves nothing.
BOOTSTRAP: Final = """
import sys
if sys.version_info < (3, 11):
    sys.stderr.write("its python3 is %d.%d, and 3.11 or later is needed\\n" % sys.version_info[:2])
    sys.exit(11)
import os
source = sys.stdin.buffer
agent = source.read(int(source.readline()))
place = os.memfd_create("agent")
with open(place, "wb", closefd=False) as file:
    file.write(agent)
sys.path.insert(0, "/proc/self/fd/%d" % place)
from segway_ecc.deploy.release.agent.main import serve
from segway_ecc.deploy.release.agent.journal import Reporter
sys.exit(serve(agent, source, Reporter(sys.stdout.buffer)))
"""


def agent_archive() -> bytes:
    """The modules of the robot's side as a zip that Python runs; the same bytes each time."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(zipfile.ZipInfo("__main__.py", _LONG_AGO), _MAIN)
        for package in _PACKAGES:
            folder = importlib.resources.files(package)
            for source in sorted(folder.iterdir(), key=lambda path: path.name):
                if source.name.endswith(".py") and (package == _PACKAGES[-1] or source.name == "__init__.py"):
                    name = f"{package.replace('.', '/')}/{source.name}"
                    archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), source.read_bytes())
    return buffer.getvalue()

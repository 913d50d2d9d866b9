# SPDX-License-Identifier: MIT
"""What a release needs of its environment: variables that its services are started with."""

from pathlib import Path
from typing import Final

from segway_ecc.deploy.release.agent.files import write_whole

NAME: Final = "environment"
"""In a release's folder; the units read it before /etc/segway-ecc/environment."""
_BOOTSTRAPPER: Final = "ros_wheels_bootstrapper"


def write_environment(folder: Path, place: Path | None = None) -> None:
    """Write the variables of a release that is installed; no file where it needs none.

    ROS 2 from PyPI needs its libraries in LD_LIBRARY_PATH. Where that is not set its start hook looks for them and
    starts Python a second time, each time; with the variables here that is saved.

    Args:
        folder: The release's, with its virtual environment.
        place: Where that folder will be; None where it is there already.
    """
    found = sorted(folder.glob(f"venv/lib/python3*/site-packages/{_BOOTSTRAPPER}"))
    (folder / NAME).unlink(missing_ok=True)
    if not found:
        return
    libraries = [folder / "venv" / "lib", *sorted(found[0].parent.glob("ros_*.libs"))]
    there = [str((place or folder) / path.relative_to(folder)) for path in libraries]
    text = f"_ROS_WHEELS_BOOTSTRAP_COMPLETE=1\nLD_LIBRARY_PATH={':'.join(there)}\n"
    write_whole(folder / NAME, text.encode())

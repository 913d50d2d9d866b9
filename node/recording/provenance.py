# SPDX-License-Identifier: MIT
"""Where the run in a log comes from; the software and the machine are added by the process that writes the log."""

import contextlib
import importlib
import os
import sys
from typing import Final

import msgspec

ROBOT_FILE: Final = "robot.json"
"""The attachment that a replay builds the robot from: the robot file as it was in force, options included."""
ROBOT_TEXT: Final = "robot.yaml"
"""The attachment for people: the robot file as it was written."""
MODEL: Final = "model"
"""The metadata about the model: `source` and `sha256`."""
SOFTWARE: Final = "software"
_LIBRARIES: Final = ("msgspec", "python-can", "mcap", "numpy", "pyserial")


class Provenance(msgspec.Struct, frozen=True):
    """What a log holds about the run beside its messages.

    Attributes:
        attachments: Texts by file name.
        metadata: Named texts, by the name of their group.
    """

    attachments: dict[str, str]
    metadata: dict[str, dict[str, str]]


NO_PROVENANCE: Final = Provenance({}, {})


def with_surroundings(provenance: Provenance) -> Provenance:
    """The same with the software and the machine; the process that writes a log adds them, since they take long."""
    if not provenance.metadata or SOFTWARE in provenance.metadata:
        return provenance
    machine = os.uname()
    library = importlib.import_module("importlib.metadata")
    versions = dict.fromkeys(("segway-ecc", *_LIBRARIES), "not installed")
    for name in versions:
        with contextlib.suppress(library.PackageNotFoundError):
            versions[name] = library.version(name)
    metadata = {
        SOFTWARE: versions,
        "machine": {
            "host": machine.nodename,
            "system": f"{machine.sysname} {machine.release} {machine.version}",
            "machine": machine.machine,
            "python": sys.version,
        },
    }
    return Provenance(provenance.attachments, {**provenance.metadata, **metadata})

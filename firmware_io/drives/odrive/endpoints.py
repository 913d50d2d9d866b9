# SPDX-License-Identifier: MIT
"""The section `endpoints` of a robot file: `python -P -m segway_ecc.firmware_io.drives.odrive.endpoints FILE`.

ODrive publishes a `flat_endpoints.json` for each release of 0.6 and each hardware: `fw_version`, `hw_version`, and
`endpoints`, which has the `id` and `type` of each by its name (examples/can_param_access.py of
github.com/odriverobotics/ODriveResources at 06dc846 reads it so). What is compared before arming is picked from it, and
printed to be put into the robot file: that one file is all that a robot and its logs need to have.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.setting_names import FLAGS, PATHS
from segway_ecc.firmware_io.drives.odrive.settings import OdriveEndpoints

_TYPES: Final[Mapping[str, str]] = {
    path.format(0): "bool" if setting in FLAGS else "float" for setting, path in PATHS[Firmware.V0_6].items()
}
"""What is compared, and the type that it is read as."""
_MOST_BYTES: Final = 10_000_000


class EndpointsError(Exception):
    """A file has no endpoints that can be used; the text states why and what to do."""


class _Endpoint(msgspec.Struct, frozen=True):
    id: int
    type: str


class _Document(msgspec.Struct, frozen=True):
    fw_version: str
    hw_version: str
    endpoints: dict[str, Any]


def endpoints_of(data: bytes) -> OdriveEndpoints:
    """What a `flat_endpoints.json` has of the settings that are compared.

    Raises:
        EndpointsError: It is another document, has none of them, or one of another type.
    """
    try:
        document = msgspec.json.decode(data, type=_Document)
        found = {
            name: msgspec.convert(document.endpoints[name], _Endpoint) for name in _TYPES if name in document.endpoints
        }
        ids = {name: endpoint.id for name, endpoint in found.items()}
        versions = {"firmware": document.fw_version, "hardware": document.hw_version}
        section = msgspec.convert({**versions, "ids": ids}, OdriveEndpoints)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise EndpointsError(f"this is no flat_endpoints.json of a release of 0.6: {error}") from error
    wrong = [
        f"{name} is of type {e.type!r:.40}, read as {_TYPES[name]}"
        for name, e in found.items()
        if e.type != _TYPES[name]
    ]
    if wrong:
        raise EndpointsError(f"{wrong[0]}: this release of the firmware is not known here")
    return section


def section_of(endpoints: OdriveEndpoints) -> str:
    """The section as it stands in a robot file under `hardware`."""
    ids = "".join(f"      {name}: {number}\n" for name, number in endpoints.ids.items())
    return f"  endpoints:\n    firmware: {endpoints.firmware}\n    hardware: {endpoints.hardware}\n    ids:\n{ids}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the section made from the file of the command line, and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -P -m segway_ecc.firmware_io.drives.odrive.endpoints",
        description="Print the section 'endpoints' of a robot file.",
    )
    parser.add_argument("file", type=Path, help="flat_endpoints.json of the drives' release and hardware")
    file = parser.parse_args(arguments).file
    try:
        with file.open("rb") as opened:
            section = section_of(endpoints_of(opened.read(_MOST_BYTES)))
    except (OSError, EndpointsError) as error:
        sys.stderr.write(f"{file}: {error.strerror if isinstance(error, OSError) else error}\n")
        return 1
    sys.stdout.write(section)
    return 0


if __name__ == "__main__":
    sys.exit(main())

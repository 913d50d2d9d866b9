# SPDX-License-Identifier: MIT
"""Takes a base station away, but for its logs."""

import contextlib

from segway_ecc.deploy.station.installer.machine import TargetMachine
from segway_ecc.deploy.station.installer.rendering import ALL_FILES, ENVIRONMENT, FIREWALL, STATION, UNITS
from segway_ecc.deploy.station.installer.tokens import ACCESS, delete_tokens


def remove(machine: TargetMachine) -> list[str]:
    """Stop the service and delete its files.

    The user stays: the logs are its own, and the number must not become somebody else's.

    Returns:
        The files that were deleted.

    Raises:
        NodeError: Something could not be stopped or deleted.
    """
    if machine.is_live:
        for unit in (STATION, FIREWALL):
            if machine.path(f"{UNITS}/{unit}").exists():
                machine.run(["systemctl", "--quiet", "disable", "--now", unit])
    gone = [ACCESS] if delete_tokens(machine) else []
    links = [f"{UNITS}/multi-user.target.wants/{unit}" for unit in (STATION, FIREWALL)]
    gone += [name for name in (*links, *ALL_FILES) if machine.delete(name)]
    with contextlib.suppress(OSError):  # where something else of ours is in it
        machine.path(ENVIRONMENT).parent.rmdir()
    if machine.is_live:
        machine.run(["systemctl", "daemon-reload"])
    return gone

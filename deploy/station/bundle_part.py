# SPDX-License-Identifier: MIT
"""The support bundle's part on the robots of the ROS network, as `segway-ecc station status --json` shows them."""

import time
from collections.abc import Sequence
from typing import Final

from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.views import FleetView
from segway_ecc.deploy.support.bundle import Collected, json_text
from segway_ecc.node.ros.runtime import discovery_text, require_ros

_POLL_S: Final = 0.05


def robots(ros_arguments: Sequence[str] = (), patience_s: float = 5.0) -> Collected:
    """A picture of every robot that is found.

    Args:
        ros_arguments: What followed `--ros-args` on the command line, that flag included.
        patience_s: How long to wait for all reports, s.
    """
    require_ros()
    deadline_s = time.monotonic() + patience_s
    with Station("support", ros_arguments=ros_arguments, is_watching=True) as station:
        fleet = station.fleet()
        while time.monotonic() < deadline_s and not (
            fleet.robots and all(robot.timing or not robot.is_alive for robot in fleet.robots)
        ):
            time.sleep(_POLL_S)
            fleet = station.fleet()
    if not fleet.robots:
        return Collected({}, [f"no robot was found within {patience_s:g} s ({discovery_text()})"])
    return picture(fleet)


def picture(fleet: FleetView) -> Collected:
    """A picture that is there already."""
    return Collected({"robots.json": json_text(fleet)})

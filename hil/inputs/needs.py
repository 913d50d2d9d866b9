# SPDX-License-Identifier: MIT
"""What a trial needs of the machine, and why it cannot be had here."""

import importlib.util

from segway_ecc.node.ros.runtime import missing_packages


def no_ros() -> str:
    """Why nothing can be tried in ROS here; empty where it can."""
    return f"no ROS: no {', '.join(missing)}" if (missing := missing_packages()) else ""


def no_station() -> str:
    """Why no base station can serve its page here; empty where one can."""
    return no_ros() or ("" if importlib.util.find_spec("aiohttp") else "no base station: no aiohttp")

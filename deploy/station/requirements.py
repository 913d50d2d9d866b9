# SPDX-License-Identifier: MIT
"""What the station needs of the environment that it runs in."""

import importlib.util

from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.ros.runtime import require_ros


def require_station() -> None:
    """Make sure that the page can be served, and robots be reached over ROS.

    Raises:
        ConfigurationError: What serves it is not installed.
        RosUnavailableError: ROS is missing.
    """
    require_web()
    require_ros()


def require_web() -> None:
    """Make sure that pages can be served.

    Raises:
        ConfigurationError: What serves them is not installed.
    """
    if importlib.util.find_spec("aiohttp") is None:
        raise ConfigurationError(
            "the station serves with aiohttp, which is not installed: pip install 'segway-ecc[station]'"
        )

# SPDX-License-Identifier: MIT
"""A page that is served to the browsers of this machine alone: its options, and how it is opened."""

import argparse
import logging
import os
import webbrowser
from typing import Final

from segway_ecc.node.errors import ConfigurationError

LOOPBACK: Final = "127.0.0.1"
_LARGEST_PORT: Final = 65_535
_DISPLAYS: Final = ("DISPLAY", "WAYLAND_DISPLAY")
_logger = logging.getLogger(__name__)


def add_page(parser: argparse.ArgumentParser, port: int) -> None:
    """Where the page is, usually at `port`, and whether it is opened."""
    option = parser.add_argument
    option("--port", type=int, default=port, help=f"of the page, 0 for any that is free (default: {port})")
    option("--browser", action=argparse.BooleanOptionalAction, help="open the page (default: where there is a screen)")


def check_port(port: int) -> None:
    """Refuse what is no port.

    Raises:
        ConfigurationError: It is none.
    """
    if not 0 <= port <= _LARGEST_PORT:
        raise ConfigurationError(f"--port is 0 to {_LARGEST_PORT}")


def open_page(address: str, ends: str, *, wanted: bool | None) -> None:
    """Open the page where somebody can see it, or as it is `wanted`; and log where it is, and what Ctrl-C ends."""
    has_screen = any(os.environ.get(name) for name in _DISPLAYS)
    is_open = (has_screen if wanted is None else wanted) and webbrowser.open(address)
    _logger.info("%s %s; Ctrl-C ends %s", "the page is open:" if is_open else "open", address, ends)

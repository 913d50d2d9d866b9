# SPDX-License-Identifier: MIT
"""`segway-ecc demo [ROBOT]`: a simulated robot and its base station in the browser, to see, push and break."""

import argparse
import contextlib
import importlib
import importlib.metadata
import logging
import os
import sys
import tempfile
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.archive_client import ArchiveClient
from segway_ecc.deploy.station.requirements import require_station
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.station_bundle import StationBundle
from segway_ecc.deploy.station.web.site_address import bind, site_address_of, url
from segway_ecc.deploy.support.archive_service import ArchiveCalls
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.hil.demo.bench import TestBench
from segway_ecc.hil.demo.parts import DemoParts, PartsSetup
from segway_ecc.hil.processes import inherited, own_ros_domain
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, print_found, stopped_by_signals
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages

_BEST: Final = "segway"
_ADDRESS: Final = "127.0.0.1"
_PORT: Final = 8700
_LARGEST_PORT: Final = 65_535
_DISPLAYS: Final = ("DISPLAY", "WAYLAND_DISPLAY")
_logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `demo`."""
    option = parser.add_argument
    option("robot", nargs="?", default=_BEST, help=f"a robot file, or a packaged robot (default: {_BEST})")
    option("--port", type=int, default=_PORT, help=f"of the page, 0 for any that is free (default: {_PORT})")
    option("--browser", action=argparse.BooleanOptionalAction, help="open the page (default: where there is a screen)")
    add_json(parser)


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Show the robot until Ctrl-C."""
    if not 0 <= options.port <= _LARGEST_PORT:
        raise ConfigurationError(f"--port is 0 to {_LARGEST_PORT}")
    require_station()
    file = load_robot(options.robot)
    if isinstance(file.hardware, NoHardwareSection):
        raise ConfigurationError(f"robot '{options.robot}' is all model: demo needs one with drives, such as {_BEST}")
    # A domain of its own: no real robot of this network is on the page, and nobody else finds this one.
    with contextlib.ExitStack() as stack:
        for name, value in own_ros_domain().items():
            stack.enter_context(inherited(name, value))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="segway-ecc-demo-")))
        stack.enter_context(messages())
        report = _show(options, file, folder)
    print_found(options, report, {"ended by": str(report["ended_by"])})
    return 0


def _show(options: argparse.Namespace, file: RobotFile, folder: Path) -> Mapping[str, object]:
    server = importlib.import_module("segway_ecc.deploy.station.web.server")  # only here: it needs aiohttp
    logs = folder / "logs"
    logs.mkdir()
    bus = ("--interface", "local", "--channel", f"demo_{os.getpid()}")
    plant = simulated_plant(file)
    with contextlib.ExitStack() as stack:
        sockets = bind(_ADDRESS, options.port)
        for bound in sockets:
            stack.callback(bound.close)
        place = site_address_of(sockets, "http", [])
        sys.stderr.write(f"segway-ecc: starting '{options.robot}', its plant and its guard\n")
        setup = PartsSetup(options.robot, bus, folder, ("--ros", "--log", str(logs / f"{file.name}.mcap")))
        parts = stack.enter_context(DemoParts(setup))
        archive = stack.enter_context(contextlib.closing(ArchiveClient(ArchiveCalls(()), folder / "fetched")))
        station = stack.enter_context(Station("demo", folder=folder))
        states, measured = [state.name for state in plant.states], [output.name for output in plant.outputs]
        bench = stack.enter_context(contextlib.closing(TestBench(station, parts, states, measured, RealClock())))
        version = importlib.metadata.version("segway-ecc")
        settings = server.ServerSettings(
            place, folder, logs, version, StationBundle(station, archive.bundle, folder, logs), archive
        )
        address = url(_ADDRESS, place)
        report: Mapping[str, object] = server.serve(
            bench, sockets, settings, stopped_by_signals, lambda: _open(options, address)
        )
    return report


def _open(options: argparse.Namespace, address: str) -> None:
    """Open the page where somebody can see it."""
    has_screen = any(os.environ.get(name) for name in _DISPLAYS)
    wanted = has_screen if options.browser is None else options.browser
    is_open = wanted and webbrowser.open(address)
    _logger.info("%s %s; Ctrl-C ends all of it", "the page is open:" if is_open else "open", address)

# SPDX-License-Identifier: MIT
"""`segway-ecc demo [ROBOT]`: a simulated robot and its base station in the browser, to see, push and break."""

import argparse
import contextlib
import importlib
import importlib.metadata
import socket
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.archive_client import ArchiveClient
from segway_ecc.deploy.station.local_page import LOOPBACK, add_page, check_port, open_page
from segway_ecc.deploy.station.requirements import require_web
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.station_bundle import StationBundle
from segway_ecc.deploy.station.web.site_address import bind, site_address_of, url
from segway_ecc.hil.demo.bench import TestBench
from segway_ecc.hil.demo.shown import LOGS, ShownRobot, in_lock_step, over_processes
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, print_found, stopped_by_signals
from segway_ecc.node.config import NoHardwareSection, load_robot
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages
from segway_ecc.node.model.model import Model
from segway_ecc.node.ros.runtime import missing_packages, require_ros

_BEST: Final = "segway"
_PORT: Final = 8700


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `demo`."""
    option = parser.add_argument
    option("robot", nargs="?", default=_BEST, help=f"a robot file, or a packaged robot (default: {_BEST})")
    option(
        "--ros",
        action=argparse.BooleanOptionalAction,
        help="as processes over ROS, or in one process and in lock step with the plant (default: over ROS if there)",
    )
    add_page(parser, _PORT)
    add_json(parser)


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Show the robot until Ctrl-C."""
    check_port(options.port)
    require_web()
    if options.ros:
        require_ros()
    file = load_robot(options.robot)
    if isinstance(file.hardware, NoHardwareSection):
        raise ConfigurationError(f"robot '{options.robot}' is all model: demo needs one with drives, such as {_BEST}")
    over_ros = not missing_packages() if options.ros is None else options.ros
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="segway-ecc-demo-")))
        (folder / LOGS).mkdir()
        stack.enter_context(messages())
        sockets = bind(LOOPBACK, options.port)
        for bound in sockets:
            stack.callback(bound.close)
        plant = simulated_plant(file)  # without one nothing is started
        shown = stack.enter_context((over_processes if over_ros else in_lock_step)(options.robot, file, folder))
        report = _serve(options, sockets, (shown, plant), folder)
    print_found(options, report, {"ended by": str(report["ended_by"])})
    return 0


def _serve(
    options: argparse.Namespace, sockets: Sequence[socket.socket], simulated: tuple[ShownRobot, Model], folder: Path
) -> Mapping[str, object]:
    shown, plant = simulated
    states, measured = [state.name for state in plant.states], [output.name for output in plant.outputs]
    server = importlib.import_module("segway_ecc.deploy.station.web.server")  # only here: it needs aiohttp
    place = site_address_of(sockets, "http", [])
    with contextlib.ExitStack() as stack:
        archive = stack.enter_context(contextlib.closing(ArchiveClient(shown.archives, folder / "fetched")))
        station = stack.enter_context(Station("demo", shown.connect, folder=folder))
        bench = stack.enter_context(contextlib.closing(TestBench(station, shown.parts, states, measured, shown.clock)))
        bundle = StationBundle(station, archive.bundle, folder, folder / LOGS)
        version = importlib.metadata.version("segway-ecc")
        settings = server.ServerSettings(place, folder, folder / LOGS, version, bundle, archive)
        address = url(LOOPBACK, place)
        report: Mapping[str, object] = server.serve(
            bench,
            sockets,
            settings,
            stopped_by_signals,
            lambda: open_page(address, "all of it", wanted=options.browser),
        )
    return report

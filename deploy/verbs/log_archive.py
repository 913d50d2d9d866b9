# SPDX-License-Identifier: MIT
"""`segway-ecc log archive ROBOT`: hands out the robot's logs and support bundles over ROS 2; runs beside the robot."""

import argparse
import contextlib
import datetime as dt
import logging
import os
import tempfile
from functools import partial
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.station_bundle import robots
from segway_ecc.deploy.support.archive_files import NODE
from segway_ecc.deploy.support.archive_service import ArchiveServer
from segway_ecc.deploy.support.bundle import write_bundle
from segway_ecc.deploy.support.file_store import FileStore
from segway_ecc.deploy.support.machine_bundle import BundleOptions, machine_parts
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_namespace, default_log, stopped_by_signals
from segway_ecc.node.config import load_robot, packaged_robots, read_text
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages
from segway_ecc.node.ros.runtime import require_ros, ros_node

_NICENESS: Final = 10
_MEGABYTE: Final = 1e6
_FASTEST: Final = 100.0
_MOST_LOG_BYTES: Final = 20 * 1024 * 1024
"""In a bundle that goes over the network; larger logs can be fetched one by one."""
_logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `log archive`."""
    parser.add_argument("robot", help=f"a robot file, or one of {', '.join(packaged_robots())}")
    add_namespace(parser)
    parser.add_argument("--folder", type=Path, metavar="DIR", help="where the logs lie")
    parser.add_argument(
        "--rate", type=float, default=2.0, metavar="MB/S", help="how much may leave in a second (default: 2)"
    )


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Hand out until Ctrl-C or SIGTERM."""
    if not 0.0 < options.rate <= _FASTEST:
        raise ConfigurationError(f"--rate is more than 0 and at most {_FASTEST:g} MB/s")
    name, text = load_robot(options.robot).name, read_text(options.robot)
    folder: Path = options.folder or default_log("").parent
    require_ros()
    with contextlib.suppress(OSError):
        os.nice(_NICENESS)
    content = BundleOptions(
        folder,
        most_bytes=_MOST_LOG_BYTES,
        logs_of=(name,),
        robot=text,
        robots=partial(robots, options.ros_arguments),
    )

    def make_bundle(place: Path) -> Path:
        now = dt.datetime.now(dt.UTC)
        path = place / f"support-{now:%Y%m%dT%H%M%S%f}Z.zip"
        write_bundle(path, machine_parts(content), {"robot": name}, now.isoformat(timespec="seconds"))
        return path

    ended: list[str] = []
    with (
        messages(),
        tempfile.TemporaryDirectory(prefix="segway-ecc-archive-", ignore_cleanup_errors=True) as work,
        stopped_by_signals(ended.append),
        ros_node(NODE, options.namespace, options.ros_arguments) as node,
    ):
        file_store = FileStore(folder, Path(work), make_bundle, robots=(name,))
        server = ArchiveServer(node, file_store.answer, options.rate * _MEGABYTE)
        place = node.get_fully_qualified_name()
        _logger.info("handing out logs of '%s' in %s as %s, at most %g MB/s", name, folder, place, options.rate)
        server.run(lambda: bool(ended))
        file_store.close()
    return 0

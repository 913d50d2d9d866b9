# SPDX-License-Identifier: MIT
"""`segway-ecc log view LOG`: plays a log in the browser: the scene, the plots and the events of each moment.

Exit codes: 0 ended by Ctrl-C; 2 arguments; 9 the log cannot be read.
"""

import argparse
import importlib
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.local_page import LOOPBACK, add_page, check_port, open_page
from segway_ecc.deploy.station.requirements import require_web
from segway_ecc.deploy.station.web.site_address import bind, site_address_of, url
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, print_found, stopped_by_signals
from segway_ecc.node.errors import ConfigurationError, RecordingError
from segway_ecc.node.logs import messages

_PORT: Final = 8701
_LATEST_S: Final = 1e7


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `log view`."""
    option = parser.add_argument
    option("log", type=Path, metavar="LOG", help="the log (MCAP); of several files, one")
    option("--at", type=float, default=0.0, metavar="S", help="the moment to begin with, since its first cycle")
    add_page(parser, _PORT)
    add_json(parser)


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    check_port(options.port)
    if not 0.0 <= options.at <= _LATEST_S:
        raise ConfigurationError(f"--at is 0 to {_LATEST_S:g} s")
    log: Path = options.log
    if log.exists() and not log.is_file():  # a pipe would be waited for
        raise RecordingError(f"cannot read the log {log}: it is no file")
    try:
        log.open("rb").close()
    except OSError as error:
        raise RecordingError(f"cannot read the log {log}: {error.strerror}") from None
    require_web()
    server = importlib.import_module("segway_ecc.deploy.station.web.log_server")  # only here: it needs aiohttp
    downloads = importlib.import_module("segway_ecc.deploy.station.web.downloads")
    sockets = bind(LOOPBACK, options.port)
    try:
        place = site_address_of(sockets, "http", [])
        moment = f"&t={options.at:g}" if options.at else ""
        address = f"{url(LOOPBACK, place).rstrip('/')}{downloads.player_path(log.name)}{moment}"
        with messages():
            ended_by = server.serve_log(
                log, sockets, place, stopped_by_signals, lambda: open_page(address, "it", wanted=options.browser)
            )
    finally:
        for bound in sockets:
            bound.close()
    print_found(options, {"ended_by": ended_by, "address": address}, {"ended by": ended_by})
    return 0

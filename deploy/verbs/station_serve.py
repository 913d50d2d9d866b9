# SPDX-License-Identifier: MIT
"""`segway-ecc station serve`: the base station, one page in the browser for every robot on the ROS network."""

import argparse
import contextlib
import importlib
import importlib.metadata
import logging
import socket
import ssl
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.archive_client import ArchiveClient
from segway_ecc.deploy.station.local_page import check_port
from segway_ecc.deploy.station.requirements import require_station
from segway_ecc.deploy.station.ros_bridge import ros_network
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.station_bundle import StationBundle
from segway_ecc.deploy.station.web.access import Access, Role, load_access, new_access
from segway_ecc.deploy.station.web.site_address import SiteAddress, bind, site_address_of, tls_context, url
from segway_ecc.deploy.support.archive_service import ArchiveCalls
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, default_log, print_found, stopped_by_signals
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages

PLAIN_HTTP: Final = "plain HTTP: whoever is on this network can read the token and use it; give --certificate and --key"
_PORT: Final = 8700
_LONGEST_NAME: Final = 80
_logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `station serve`."""
    add_json(parser)
    option = parser.add_argument
    option("--address", default="127.0.0.1", help="where to listen (default: 127.0.0.1, for this machine only)")
    option("--port", type=int, default=_PORT, help=f"where to listen, 0 for any that is free (default: {_PORT})")
    add_listening(parser)
    option("--require-token", action="store_true", help="ask for a token on loopback too")
    option("--folder", type=Path, metavar="DIR", help="where tokens, stops and the audit log are kept")
    option("--logs", type=Path, metavar="DIR", help="where the logs lie that the page offers")
    option("--name", default="", help="what the robots know the station by (default: this machine's name)")


def add_listening(parser: argparse.ArgumentParser) -> None:
    """By which names the page is served, with which certificate, and whether tokens are made anew."""
    option = parser.add_argument
    option("--host", action="append", default=[], metavar="NAME", help="another name by which browsers find us")
    option("--certificate", type=Path, metavar="FILE", help="certificate chain for TLS, PEM")
    option("--key", type=Path, metavar="FILE", help="its private key, where it is not in the same file")
    option("--new-tokens", action="store_true", help="make new tokens; the old ones are good for nothing any more")


def show_tokens(tokens: Mapping[Role, str]) -> None:
    """Print new tokens, at once, since they hold whatever fails next; never through the messages, which may be kept."""
    rows = "".join(f"  {role.value:<8}  {token}\n" for role, token in tokens.items())
    sys.stderr.write(f"segway-ecc: new tokens, shown this once; keep them:\n{rows}")
    sys.stderr.flush()


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    check_port(options.port)
    if options.key is not None and options.certificate is None:
        raise ConfigurationError("--key is of no use without --certificate")
    require_station()
    tls = None if options.certificate is None else tls_context(options.certificate, options.key)
    sockets = bind(options.address, options.port)
    try:
        place = site_address_of(sockets, "http" if tls is None else "https", options.host)
        folder: Path = options.folder or default_log("").parents[1] / "station"
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise ConfigurationError(f"--folder {folder} cannot be made: {error.strerror}") from None
        access = _access(options, folder, place)
        with messages():
            report = _serve(options, sockets, place, (access, tls, folder))
    finally:
        for bound in sockets:
            bound.close()
    refused = report["refused"]
    total = ", ".join(f"{cause} {count}" for cause, count in refused.items()) if isinstance(refused, dict) else ""
    print_found(options, report, {"ended by": str(report["ended_by"]), "refused": total or "nothing"})
    return 0


def _access(options: argparse.Namespace, folder: Path, place: SiteAddress) -> Access | None:
    """Who gets in; tokens are made at the first start that needs them."""
    if place.is_loopback and not options.require_token and not options.new_tokens:
        return None
    path = folder / "access.json"
    access = None if options.new_tokens else load_access(path)
    if access is None:
        access, tokens = new_access()
        access.save(path)
        show_tokens(tokens)
    return access if not place.is_loopback or options.require_token else None


def _serve(
    options: argparse.Namespace,
    sockets: Sequence[socket.socket],
    place: SiteAddress,
    means: tuple[Access | None, ssl.SSLContext | None, Path],
) -> Mapping[str, object]:
    # Only here, so that missing aiohttp is reported in one line.
    server = importlib.import_module("segway_ecc.deploy.station.web.server")
    access, tls, folder = means
    name = str(options.name or socket.gethostname())[:_LONGEST_NAME]
    if not name.isprintable():
        raise ConfigurationError("--name has letters that cannot be printed")
    logs = options.logs or default_log("").parent

    def log_address() -> None:
        if not place.is_loopback and place.scheme == "http":
            _logger.warning(PLAIN_HTTP)
        _logger.info("open %s", url(options.address, place))

    with (
        contextlib.closing(ArchiveClient(ArchiveCalls(options.ros_arguments), folder / "fetched")) as archive,
        Station(name, partial(ros_network, options.ros_arguments), folder=folder) as station,
    ):
        settings = server.ServerSettings(
            place,
            folder,
            logs,
            importlib.metadata.version("segway-ecc"),
            StationBundle(station, archive.bundle, folder, logs),
            archive,
            access,
            tls,
        )
        report: Mapping[str, object] = server.serve(station, sockets, settings, stopped_by_signals, log_address)
    return report

# SPDX-License-Identifier: MIT
"""`segway-ecc log bundle`: what a maintainer needs to find out what went wrong, in one zip."""

import argparse
import datetime as dt
import re
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.deploy.station.station_bundle import robots
from segway_ecc.deploy.support.bundle import write_bundle
from segway_ecc.deploy.support.machine_bundle import BundleOptions, machine_parts
from segway_ecc.node.cli.options import add_json, default_log, print_found
from segway_ecc.node.config import load_robot, packaged_robots, read_text
from segway_ecc.node.errors import ConfigurationError

_MOST_LOGS: Final = 1000
_NOT_PLAIN: Final = re.compile(r"[^A-Za-z0-9._-]")
_KIB: Final = 1024


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `log bundle`."""
    parser.add_argument("robot", nargs="?", help=f"a robot file to put in, or one of {', '.join(packaged_robots())}")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where it goes (default: here, by robot and time)")
    parser.add_argument("--logs", type=int, default=1, metavar="N", help="how many of the newest logs (default: 1)")
    parser.add_argument("--log-folder", type=Path, metavar="DIR", help="where the logs lie")
    parser.add_argument("--station", type=Path, metavar="DIR", help="a base station's folder, for its audit log")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Make the bundle and show what is in it."""
    if not 0 <= options.logs <= _MOST_LOGS:
        raise ConfigurationError(f"--logs is 0 to {_MOST_LOGS}")
    text = None if options.robot is None else read_text(options.robot)
    made = dt.datetime.now(dt.UTC)
    name = "machine"
    if options.robot is not None:
        try:
            name = load_robot(options.robot).name
        except ConfigurationError:  # a file that is not as it must be may be what the bundle is made for
            name = Path(options.robot).stem
        name = _NOT_PLAIN.sub("_", name) or "robot"
    out: Path = options.out or Path(f"segway-ecc-support-{name}-{made:%Y%m%dT%H%M%SZ}.zip")
    content = BundleOptions(
        logs=options.log_folder or default_log("").parent,
        log_count=options.logs,
        robot=text,
        station=options.station,
        robots=partial(robots, options.ros_arguments),
    )
    try:
        manifest = write_bundle(out, machine_parts(content), {"robot": name}, made.isoformat(timespec="seconds"))
        size = out.stat().st_size
    except OSError as error:
        raise ConfigurationError(f"--out {out} cannot be written: {error.strerror}") from None
    rows = {}
    for part in manifest.parts:
        total = sum(file.bytes for file in part.files)
        has = f"{', '.join(file.name for file in part.files)} ({total / _KIB:.0f} KiB)" if part.files else ""
        lacks = f"not: {'; '.join(part.missing)}" if part.missing else ""
        rows[part.part] = "; ".join(filter(None, (has, lacks)))
    document = {"file": str(out), "bytes": size, **msgspec.to_builtins(manifest)}
    print_found(options, document, {**rows, "bundle": f"{out} ({size / _KIB:.0f} KiB)"})
    return 0

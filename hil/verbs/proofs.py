# SPDX-License-Identifier: MIT
"""What the verbs that prove and measure share: options, what is printed, and the folder of `--out`."""

import argparse
import contextlib
import fcntl
import functools
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import msgspec

from segway_ecc.hil.floor.contact import LEAST_FRICTION, MOST_FRICTION
from segway_ecc.node.cli.options import add_json, output_folder
from segway_ecc.node.errors import ConfigurationError


def add_packaged_robot(parser: argparse.ArgumentParser, default: str) -> None:
    """The robot file, which may be left out."""
    parser.add_argument("robot", nargs="?", default=default, help="a robot file, or the name of a packaged robot")


def add_count(parser: argparse.ArgumentParser, name: str, what: str = "processes at a time") -> None:
    """A number of things that is the number of this machine's cores where it is not given; see `check_counts`."""
    cores = len(os.sched_getaffinity(0))
    parser.add_argument(f"--{name}", type=int, default=cores, metavar="N", help=f"{what} (default: cores)")


def add_study(parser: argparse.ArgumentParser) -> None:
    """What every study has: its quick part, its report and its JSON."""
    parser.add_argument("--quick", action="store_true", help="a part of it, in some seconds")
    parser.add_argument(
        "--out", type=output_folder, metavar="FOLDER", help="write the report there, and what was found as JSON"
    )
    add_json(parser)


def check_counts(options: argparse.Namespace, *names: str) -> None:
    """Refuse numbers of things that are less than 1; one that is not given is None.

    Raises:
        ConfigurationError: One is.
    """
    for name in names:
        value = getattr(options, name)
        if value is not None and value < 1:
            raise ConfigurationError(f"--{name} must be at least 1, not {value}")


def add_floor(parser: argparse.ArgumentParser, what: str = "on a floor of this friction, on which wheels slip") -> None:
    """The friction of a floor, 1; see `check_floor`."""
    parser.add_argument("--floor", type=float, metavar="MU", help=what)


def check_floor(options: argparse.Namespace) -> None:
    """Refuse a friction that no floor has; None is not looked at.

    Raises:
        ConfigurationError: It has not.
    """
    if options.floor is not None and not LEAST_FRICTION <= options.floor <= MOST_FRICTION:
        text = f"--floor must be within {LEAST_FRICTION:g} to {MOST_FRICTION:g}, not {options.floor:g}"
        raise ConfigurationError(text)


def claims_out(run: Callable[[argparse.Namespace], int]) -> Callable[[argparse.Namespace], int]:
    """Have a verb make the folder of its `--out`, if any, before it begins, and be the only one that writes there.

    Raises:
        ConfigurationError: It cannot be written to, or another study writes there.
    """

    @functools.wraps(run)
    def claiming(options: argparse.Namespace) -> int:
        if options.out is None:
            return run(options)
        with contextlib.ExitStack() as stack:
            with writing_to(options.out):
                options.out.mkdir(parents=True, exist_ok=True)
                lock = stack.enter_context((options.out / ".lock").open("a"))
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    text = f"another study writes to {options.out}: wait for its end, or choose another --out"
                    raise ConfigurationError(text) from None
            return run(options)

    return claiming


@contextlib.contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Write into it.

    Raises:
        ConfigurationError: It cannot be written to.
    """
    try:
        yield
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}; choose another --out") from error


def has_figures() -> bool:
    """Whether figures can be drawn here; where not, a message on standard error gives the remedy."""
    found = importlib.util.find_spec("matplotlib") is not None
    if not found:
        sys.stderr.write("segway-ecc: no report: install 'segway-ecc[report]' for its figures\n")
    return found


def write_report(
    folder: Path | None, name: str, document: object, draw: Callable[[], Mapping[str, str | bytes]]
) -> None:
    """Write what a study found as `name`.json into a folder that is there, with its figures; into None, nothing.

    `draw` makes the page or figures, by file name; it is called only where figures can be drawn.

    Raises:
        ConfigurationError: It cannot be written.
    """
    if folder is None:
        return
    with writing_to(folder):
        (folder / f"{name}.json").write_bytes(msgspec.json.format(msgspec.json.encode(document)))
        if has_figures():
            for file, content in draw().items():
                (folder / file).write_bytes(content.encode() if isinstance(content, str) else content)
                sys.stderr.write(f"segway-ecc: report: {folder / file}\n")

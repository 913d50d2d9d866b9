"""segway-ecc: the command line. Data on standard output, messages on standard error.

Exit codes: 0 done; 1 another error of ours; 2 arguments, robot file or sequence file; 3 model; 4 hardware; 5 ROS 2
missing; 6 nobody listens; 7 robot lost; 8 simulation; 9 log; 10 a robot in
FAULT; 11 update refused; 12 version not healthy; 130 Ctrl-C.
"""

import argparse
import importlib
import os
import re
import sys
from collections.abc import Sequence
from typing import Any, Final, NoReturn

from firmware_io.errors import HardwareError
from hil.errors import RigError
from node.cli.interrupts import ends_at_once
from node.errors import ConfigurationError, NodeError

VERBS: Final = {
    "inspect": "what a model is: ports, parameters and states with units, and what a write to each does",
    "simulate": "run a model alone, under given inputs",
    "run": "run a robot: the model node",
    "status": "which robots are on the ROS network, and how each of them is",
    "supervise": "the base station: a page in the browser that shows and commands every robot on the ROS network",
    "archive": "hand out a robot's logs and support bundles over ROS 2, on the robot",
    "support-bundle": "what a maintainer needs to find out what went wrong, in one zip",
    "sequence": "drive a robot through a sequence of set-points, over ROS 2",
    "guard": "disable the drives when commands stop, whatever became of the node",
    "plant": "the simulated plant and drive at the other end of a robot's bus, in real time",
    "failover": "lose the bus in every way there is, and measure when the serial line carries the robot on",
    "hil": "run one declared scenario of faults in lock step, and see whether it comes as declared",
    "campaign": "run all declared scenarios side by side, and report what is not as declared",
    "kill-drill": "kill, stop and cut every part of a driving robot, and measure when the torque ends",
    "play": "the whole robot on this machine, to drive with the arrow keys",
    "design": "the gains of a balancing robot from what it is made of, with poles and margins",
    "margins": "how much the balancing robot bears, found by search, against what is required of it",
    "endurance": "hours of normal driving in lock step, with lost frames: nothing may trip",
    "replay": "a recorded run through the same model and safety code again: identical, or what differs first",
    "traffic": "write the raw traffic on a robot's bus as a candump log",
    "deploy": "put a version onto a robot over ssh, take it back, or see what is there",
    "base-station": "make this machine a base station: service, tokens, discovery, firewall",
    "image": "build an image for the robot: a root file system and a disk, from Debian packages and this software",
    "case-study": "the thesis' tables and figures through each seat, side by side",
    "soak": "hours in lock step and half an hour in real time: memory, files and threads must not grow",
    "study": "what comes of where each part of control runs, and what a cycle costs as robots grow",
    "doctor": "is this machine fit to run the robot, and how to mend what is not",
    "bench": "how fast this machine runs the loop, beside a user's loop and one in C",
}
_INTERRUPTED: Final = 130
_OPENSSL: Final = "_hashlib"
"""Where `hashlib` finds OpenSSL: 3.5 MB for some digests that Python has too, and takes where this is not to be had."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; the exit code says how it went."""
    try:
        with ends_at_once():
            options = _options(list(sys.argv[1:] if arguments is None else arguments))
        return int(options.function(options))
    except (NodeError, HardwareError, RigError) as error:
        sys.stderr.write(f"segway-ecc: {error}\n")
        return error.exit_code
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:
        return 0
    finally:
        _flush()


def _options(words: list[str]) -> argparse.Namespace:
    """What the command line says, with the `function` of its verb."""
    words, ros_arguments = _split_ros(words)
    parser = _Parser(prog="segway-ecc", description=__doc__.partition("\n")[0].partition(": ")[2])
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and end")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    chosen = next((word for word in words if word in VERBS), None)
    for verb, text in VERBS.items():
        verb_parser = verbs.add_parser(verb, help=text, description=text)
        if verb == chosen:
            if verb == "run":
                sys.modules.setdefault(_OPENSSL, None)  # type: ignore[arg-type]  # None: is not to be had
            # Only the verb in use is imported: a robot starts without what the others need.
            module = importlib.import_module(f"node.cli.{verb.replace('-', '_')}")
            module.add_arguments(verb_parser)
            verb_parser.set_defaults(function=module.run, ros_arguments=ros_arguments)
    return parser.parse_args(words)


class _Parser(argparse.ArgumentParser):
    """Tells what is wrong in one line, and takes a number such as -1e-3 for a number."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - argparse's own settings, handed on
        super().__init__(**settings)
        # Before Python 3.14 argparse takes what has an exponent, or is infinite, for an option.
        self._negative_number_matcher = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$|^-(inf|nan)$")

    def error(self, message: str) -> NoReturn:
        """End with one line and the exit code for arguments."""
        self.exit(ConfigurationError.exit_code, f"segway-ecc: {message}; see {self.prog} --help\n")


class _Version(argparse.Action):
    """Looks for the version where it is asked for: that takes longer than all the rest of reading the command line."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        metadata = importlib.import_module("importlib.metadata")
        sys.stdout.write(f"{metadata.version('segway-ecc')}\n")
        parser.exit()


def _flush() -> None:
    """Flush here, where a reader that has gone is expected, and not when the interpreter ends."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read our output has enough; there is nobody left to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _split_ros(words: list[str]) -> tuple[list[str], list[str]]:
    """Split off what is meant for ROS: from `--ros-args` on."""
    if "--ros-args" not in words:
        return words, []
    at = words.index("--ros-args")
    return words[:at], words[at:]


if __name__ == "__main__":
    sys.exit(main())

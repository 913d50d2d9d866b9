# SPDX-License-Identifier: MIT
"""Options and habits that several verbs share, and the tables that they write."""

import argparse
import contextlib
import csv
import datetime as dt
import importlib.util
import json
import logging
import math
import os
import re
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, TextIO

import msgspec

from segway_ecc.firmware_io.build import imu_line, takes_serial, with_imu_port, with_port
from segway_ecc.firmware_io.errors import SegwayEccError
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot, packaged_robots
from segway_ecc.node.cycle.real_time import real_time_loop
from segway_ecc.node.errors import ConfigurationError, ModelFailedError, failure_text
from segway_ecc.node.folders import state_folder
from segway_ecc.node.recording.log_name import name_of_log

_logger = logging.getLogger(__name__)
_ROS_NAME: Final = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_LONGEST_ROS_NAME: Final = 120
"""Half of what ROS takes for a topic with its namespace."""
_LINES: Final = ("interface", "channel", "serial", "imu-serial")
_STOP_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def add_robot(parser: argparse.ArgumentParser) -> None:
    """The robot file and its lines."""
    parser.add_argument("robot", help=f"a robot file, or one of {', '.join(packaged_robots())}")
    add_lines(parser)


def add_lines(parser: argparse.ArgumentParser) -> None:
    """Other lines than those of the robot file; see `robot_file`."""
    parser.add_argument("--interface", help="python-can interface instead of the robot file's, or auto")
    parser.add_argument("--channel", help="CAN channel instead of the robot file's, or auto")
    parser.add_argument("--serial", metavar="PORT", help="serial line instead of the robot file's")
    parser.add_argument("--imu-serial", metavar="PORT", help="serial line of the IMU instead of the robot file's")


def lines_of(options: argparse.Namespace) -> list[str]:
    """The options of `add_lines` that are given, as words of a command line for another process."""
    return [word for name, value in _given_lines(options).items() for word in (f"--{name}", value)]


def _given_lines(options: argparse.Namespace) -> dict[str, str]:
    given = {name: getattr(options, name.replace("-", "_")) for name in _LINES}
    return {name: value for name, value in given.items() if value is not None}


def robot_file(options: argparse.Namespace) -> RobotFile:
    """The robot file, with the bus and the serial lines that the command line names."""
    file = load_robot(options.robot)
    wanted = _given_lines(options)
    if not wanted:
        return file
    if isinstance(file.hardware, NoHardwareSection):
        raise ConfigurationError(f"--{next(iter(wanted))}: robot '{file.name}' is on no CAN bus")
    hardware = file.hardware
    imu_port = wanted.pop("imu-serial", None)
    if imu_port is not None:
        if imu_line(hardware) is None:
            raise ConfigurationError(f"--imu-serial: robot '{file.name}' has no IMU on a serial line of its own")
        hardware = with_imu_port(hardware, imu_port)
    port = wanted.pop("serial", None)
    if port is not None:
        if not takes_serial(hardware):
            raise ConfigurationError(f"--serial: the drives of robot '{file.name}' have no serial line")
        hardware = with_port(hardware, port)
    if wanted:
        if not isinstance(hardware, BusSettings):
            raise ConfigurationError(
                f"--{next(iter(wanted))}: robot '{file.name}' is on no CAN bus; name its serial line by --serial"
            )
        can = msgspec.structs.replace(hardware.can, **wanted)
        hardware = msgspec.structs.replace(hardware, can=can)
    return msgspec.structs.replace(file, hardware=hardware)


def add_model(parser: argparse.ArgumentParser) -> None:
    """A model, and what some do not contain."""
    parser.add_argument("model", help="a folder of generated code, an FMU, or package.module:Class")
    parser.add_argument("--method", help="integration method of a partial copy that does not name it")
    parser.add_argument("--step", type=float, metavar="S", help="step of a model that does not give it")


@contextlib.contextmanager
def model_failures(source: str) -> Iterator[None]:
    """Report whatever a model in Python raises, which may be anything, as one of our errors.

    Raises:
        ModelFailedError: The model of this `source` raised something.
    """
    try:
        yield
    except SegwayEccError:
        raise
    except (Exception, SystemExit) as error:
        raise ModelFailedError(f"model '{source}' failed: {failure_text(error)}") from error


def check_seconds(options: argparse.Namespace, name: str, longest_s: float) -> None:
    """Refuse a time, s, that is out of range; one that is not given is None.

    Raises:
        ConfigurationError: It is.
    """
    seconds = getattr(options, name)
    if seconds is not None and not 0.0 < seconds <= longest_s:
        raise ConfigurationError(f"--{name} must be more than 0 s and at most {longest_s:g} s")


def count_steps(name: str, seconds: float, step_s: float) -> int:
    """How many steps, each of `step_s` s, a time is.

    Raises:
        ConfigurationError: It is less than one.
    """
    steps = round(seconds / step_s)
    if steps < 1:
        raise ConfigurationError(f"--{name} is {seconds:g} s, less than a step of {step_s:g} s")
    return steps


def add_json(parser: argparse.ArgumentParser) -> None:
    """Machine-readable output."""
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Where the robot lives in the ROS graph."""
    parser.add_argument("--namespace", type=_namespace, default="", help="ROS namespace of the robot, such as /robot1")


def ros_name(text: str) -> str:
    """An argument that names a node or namespace of ROS, with those that it lies in."""
    if len(text) > _LONGEST_ROS_NAME or not _ROS_NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"'{text}' is no ROS name: letters, digits and _, no digit first, between each two a /, and at most "
            f"{_LONGEST_ROS_NAME} characters"
        )
    return text


def _namespace(text: str) -> str:
    return ros_name(text) if text.strip("/") else ""


def output_of(options: argparse.Namespace) -> TextIO:
    """Standard output, which `sys.stdout` is not with `--json`: that is then for what others print."""
    output: TextIO = getattr(options, "output", sys.stdout)
    return output


def print_json(options: argparse.Namespace, value: object) -> None:
    """Print a value as JSON on standard output; what is not finite, which JSON has no word for, is null."""
    output_of(options).write(json.dumps(_finite(value), indent=2, allow_nan=False) + "\n")


def _finite(value: object) -> object:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _finite(each) for key, each in value.items()}
    return [_finite(each) for each in value] if isinstance(value, (list, tuple)) else value


def print_found(options: argparse.Namespace, document: object, text: str | Mapping[str, str]) -> None:
    """Print what was found: as JSON with `--json`, else as text; names and texts become two aligned columns."""
    if options.json:
        print_json(options, document)
    elif isinstance(text, str):
        sys.stdout.write(text)
    else:
        width = max(map(len, text), default=0)
        sys.stdout.write("".join(f"{name:<{width}}  {value}\n" for name, value in text.items()))


def default_log(name: str) -> Path:
    """Where a run's log goes by default; see `state_folder`."""
    return state_folder() / "logs" / name_of_log(name, dt.datetime.now(dt.UTC), os.getpid())


@contextlib.contextmanager
def real_time(*, lock: bool = False) -> Iterator[None]:
    """Meet the real-time requirements of a loop while the context lasts; log once what cannot be had, and its effect.

    `lock` is whether the memory of this process is to be locked.
    """
    with real_time_loop(lock=lock) as lacking:
        for text in lacking:
            _logger.info(text)
        yield


@contextlib.contextmanager
def stopped_by_signals(stop: Callable[[str], None]) -> Iterator[None]:
    """Call `stop` with the signal's name on Ctrl-C, SIGTERM, or when the terminal goes away."""

    def handle(number: int, _frame: object) -> None:
        stop(signal.Signals(number).name)

    old = {number: signal.signal(number, handle) for number in _STOP_SIGNALS}
    try:
        yield
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def output_file(text: str) -> Path:
    """The file of an option, which can be written: looked at before the work is done for nothing.

    Raises:
        ConfigurationError: It cannot be written.
    """
    path = Path(text)
    is_there = path.exists()
    if not is_there or path.is_file() or path.is_dir():  # a pipe is not opened twice: its reader would leave
        try:
            path.open("ab").close()
            if not is_there:
                path.resolve().unlink()  # of a link whose target was not there, that; the link is the user's
        except OSError as error:
            raise ConfigurationError(f"cannot write {path}: {error.strerror}") from error
    return path


def output_folder(text: str) -> Path:
    """The folder of an option; an empty name, as of a shell's variable that is not set, is no name of this folder.

    Raises:
        ConfigurationError: It is empty.
    """
    if not text:
        raise ConfigurationError("the name of the folder to write to is empty; the current one is '.'")
    return Path(text)


def drawing_file(text: str) -> Path:
    """The file of an option that draws, which can be written and drawn; its name ends in its format.

    Raises:
        ConfigurationError: There is no drawing library, or the file cannot be written, or not in that format.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigurationError("--plot needs a drawing library: install 'segway-ecc[report]'")
    from matplotlib.backend_bases import FigureCanvasBase  # noqa: PLC0415 - an extra that everything else does without

    path, formats = output_file(text), sorted(FigureCanvasBase.get_supported_filetypes())
    if path.suffix and path.suffix[1:].lower() not in formats:
        raise ConfigurationError(f"cannot draw {path}: the formats are {', '.join(formats)}")
    return path


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table.

    Raises:
        ConfigurationError: The file cannot be written.
    """
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(rows)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}") from error

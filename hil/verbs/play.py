# SPDX-License-Identifier: MIT
"""`segway-ecc play [ROBOT]`: plant, node and guard on this machine, driven with the arrow keys."""

import argparse
import contextlib
import importlib.util
import logging
import os
import socket
import subprocess
import sys
import tempfile
import termios
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.firmware_io.build import imu_line, serial_of, takes_serial
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.hil.play.channel import LoopEnd, channel
from segway_ecc.hil.play.stage import FORCE, PlantControls, PlayStage
from segway_ecc.hil.processes import Command, command
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.node.cli.options import add_namespace, add_robot, lines_of, real_time, robot_file, stopped_by_signals
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot, packaged_robots
from segway_ecc.node.cycle.interfaces import NoRecorder, NoStage, Stage
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages_to
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.ros.remote import RemoteStage, RosBridge
from segway_ecc.node.ros.runtime import missing_packages, require_ros

_BEST: Final = "segway"
_ELSE: Final = "cart-can"
_PLANT_STARTS_WITHIN_S: Final = 30.0
_TERMINAL_ENDS_WITHIN_S: Final = 3.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `play`."""
    add_robot(parser)
    robot = next(action for action in parser._actions if action.dest == "robot")  # noqa: SLF001 - no public way
    robot.nargs, robot.required = "?", False
    robot.default = _BEST if _BEST in packaged_robots() else _ELSE
    add_namespace(parser)
    parser.add_argument("--ros", action=argparse.BooleanOptionalAction, help="with or without ROS (default: if there)")


def run(options: argparse.Namespace) -> int:
    """Run everything until q is pressed."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigurationError("play is for a person at a terminal, and this is none: use run and plant instead")
    if importlib.util.find_spec("rich") is None:
        raise ConfigurationError("play draws with rich, which is not installed: pip install 'segway-ecc[report]'")
    with tempfile.TemporaryDirectory(prefix="segway-ecc-play-") as folder, contextlib.ExitStack() as stack:
        file = msgspec.structs.replace(_with_lines(options, Path(folder)), commissioned="optional")  # it is simulated
        robot = build_robot(file, RealClock())
        plant, guard = _start(stack, options, Path(folder))
        if plant.process.stdin is None:
            raise ValueError("the plant takes no commands")
        can_be_pushed = any(state.name == FORCE for state in simulated_plant(file).states)
        rig = PlantControls(
            plant.process.stdin.fileno(),
            robot.period_ns,
            lambda: guard.process.poll() is None,
            can_be_pushed=can_be_pushed,
        )
        ours, theirs = channel()
        stage = _stage(stack, options, robot, rig, LoopEnd(ours))
        loop = robot.loop(stage, NoRecorder())
        stage.modes = loop.modes
        loop.sits_down_first = True
        stack.enter_context(_terminal(ours, theirs))
        stack.enter_context(messages_to(_Notices(stage)))
        with stopped_by_signals(loop.stop), real_time():
            loop.run()
    with contextlib.suppress(OSError):  # a terminal that has hung up shows no message
        sys.stderr.write(f"segway-ecc: stopped: {loop.stop_reason}\n")
    return 0


def _with_lines(options: argparse.Namespace, folder: Path) -> RobotFile:
    """The robot file on a bus of our own, and with a serial line where its drives have one."""
    hardware = load_robot(options.robot).hardware
    if isinstance(hardware, NoHardwareSection):
        raise ConfigurationError(f"robot '{options.robot}' is all model: play needs one with drives, such as {_ELSE}")
    if options.interface is None and options.channel is None and isinstance(hardware, BusSettings):
        options.interface, options.channel = "local", f"play_{os.getpid()}"
    if options.serial is None and takes_serial(hardware) and serial_of(hardware) is None:
        options.serial = str(folder / "serial")
    if options.imu_serial is None and imu_line(hardware) is not None:
        options.imu_serial = str(folder / "imu")
    return robot_file(options)


def _start(stack: contextlib.ExitStack, options: argparse.Namespace, folder: Path) -> tuple[Command, Command]:
    lines = [options.robot, *lines_of(options)]
    plant = stack.enter_context(command(["plant", *lines, "--control"], folder / "plant.txt", listens=True))
    plant.ask("heal", _PLANT_STARTS_WITHIN_S)
    return plant, stack.enter_context(command(["guard", *lines], folder / "guard.txt"))


def _stage(
    stack: contextlib.ExitStack, options: argparse.Namespace, robot: Robot, rig: PlantControls, terminal: LoopEnd
) -> PlayStage:
    if options.ros:
        require_ros()
    behind: Stage = NoStage()
    if options.ros is not False and not missing_packages():
        bridge = stack.enter_context(contextlib.closing(RosBridge()))
        behind, rig.has_ros = RemoteStage(bridge, robot, options.namespace, options.ros_arguments), True
    return PlayStage(behind, terminal, rig, robot)


@contextlib.contextmanager
def _terminal(ours: socket.socket, theirs: socket.socket) -> Iterator[None]:
    """The terminal's process; the terminal is as it was before when the context is left, whatever happened to it."""
    before = termios.tcgetattr(sys.stdin.fileno())
    process = subprocess.Popen(  # noqa: S603 - our own module, and no shell reads it
        [sys.executable, "-P", "-m", "segway_ecc.hil.play.terminal", str(theirs.fileno())],
        pass_fds=[theirs.fileno()],
        stdout=sys.stdout,
    )
    theirs.close()
    try:
        yield
    finally:
        ours.close()  # by which it knows that it is to end
        try:
            process.wait(_TERMINAL_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        with contextlib.suppress(termios.error):  # a terminal that has hung up needs nothing
            termios.tcsetattr(sys.stdin.fileno(), termios.TCSADRAIN, before)


class _Notices(logging.Handler):
    """Keeps what is logged for the view: nothing else may write to the terminal."""

    def __init__(self, stage: PlayStage) -> None:
        super().__init__()
        self._stage = stage

    def emit(self, record: logging.LogRecord) -> None:
        seconds = record.relativeCreated * 1e-3
        self._stage.messages.append(f"{seconds:6.1f} s  {record.getMessage()}")

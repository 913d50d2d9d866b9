# SPDX-License-Identifier: MIT
"""The running robot that an input is given to: real processes on a bus of their own, and what it can be given with."""

import contextlib
import itertools
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from segway_ecc.hil.drill.parts import DrillSetup, Parts, running, wait_until_driven
from segway_ecc.hil.drill.plant_control import Torque, read_trace, torque_after
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.inputs.ros_client import RosClient, ros_client
from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.node.config import load_robot, read_text
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import single_segment

_STARTS_WITHIN_S: Final = 30.0
_ANSWERS_WITHIN_S: Final = 5.0
_POLL_S: Final = 0.05
_STATE: Final = re.compile(rf"({'|'.join(Mode)})(?:, ({'|'.join(Posture)}))?(?::|, cannot arm:) (.*)")
_DRIVEN_S: Final = 1.5
_MODEL: Final = """\
import ctypes, math, os, signal, sys, time
from {module} import {name} as Packaged

FOLDER = os.path.dirname(__file__)
COMMANDS = {{"LeftVoltage": 17.9, "RightVoltage": 17.9, "LeftTorque": 1.6, "RightTorque": 1.6}}
begun, sign = False, 1.0


def commands(model, y, factor):
    return [COMMANDS.get(out.name, 0.0) * factor if out.name in COMMANDS else v for v, out in zip(y, model.outputs)]


def turns():
    global sign
    sign = -sign
    return sign


class Misbehaving(Packaged):
    def output(self):
        global begun
        y = super().output()
        if not begun and os.path.exists(f"{{FOLDER}}/begin"):
            begun = True
            with open(f"{{FOLDER}}/begun.new", "w") as file:
                file.write(str(time.monotonic_ns()))
            os.rename(f"{{FOLDER}}/begun.new", f"{{FOLDER}}/begun")
            {once}
        if begun:
            {always}
        return y

    def write(self, name, value):
        {write}
        super().write(name, value)
"""


@dataclass(frozen=True, slots=True)
class Misbehaviour:
    """What the robot's model does from a moment on: lines of Python.

    Attributes:
        once: Done in one step.
        always: Done in every step from then on; `y` is what the packaged model gives.
        write: Done before a variable is written.
    """

    once: str = "pass"
    always: str = "pass"
    write: str = "pass"


@dataclass(frozen=True, slots=True)
class Arrangement:
    """What runs.

    Attributes:
        changes: What stands in the packaged robot file, and what is to stand there instead.
        ros: Whether it is in ROS.
        drives: Whether it drives a sequence, without ROS; else it balances where it is. `run` ends with the sequence.
        drives_for_s: How long the sequence is, s, where that is to end; 0 for one of minutes.
        guard: Whether a guard runs.
        on_request: Whether it waits to be asked to arm.
        is_armed: Whether it is armed and driven before the input comes.
    """

    changes: tuple[tuple[str, str], ...] = ()
    model: Misbehaviour | None = None
    ros: bool = False
    drives: bool = False
    drives_for_s: float = 0.0
    guard: bool = True
    on_request: bool = False
    is_armed: bool = True


class State(NamedTuple):
    """What the robot reported last."""

    mode: str
    posture: str
    reason: str


class Place(NamedTuple):
    """Where robots run: the packaged one, and a folder for all that they write."""

    robot: str
    folder: Path
    channel: str


@dataclass(slots=True)
class Rig:
    """A robot that runs.

    Attributes:
        file: Its robot file.
        namespace: Where it is in ROS.
    """

    arrangement: Arrangement
    parts: Parts
    file: Path
    namespace: str
    _ros: RosClient | None = None
    _before: dict[str, int] = field(default_factory=dict)

    @property
    def ros(self) -> RosClient:
        """Another node in ROS, beside the robot.

        Raises:
            RigError: The robot is not in ROS.
        """
        if self._ros is None:
            raise RigError("this robot is not in ROS")
        return self._ros

    @property
    def lines(self) -> list[str]:
        """The messages of node and guard so far, in the order of the processes."""
        return self.parts.log_lines()

    @property
    def state(self) -> State:
        """What the robot reported last of itself; empty where it reported nothing."""
        found = [match for line in self.lines if (match := _STATE.match(line))]
        return State(*(text or "" for text in found[-1].groups())) if found else State("", "", "")

    @property
    def exit_code(self) -> int | None:
        """That of `run`, as a shell gives it: 128 + N for signal N; None while it runs."""
        code = self.parts.node.process.poll()
        return code if code is None or code >= 0 else 128 - code

    def torque(self, since_ns: int) -> Torque:
        """What became of the torque at the drives, from a moment until now."""
        return torque_after(read_trace(self.parts.setup.trace), since_ns, time.monotonic_ns())

    def request(self, line: str) -> int:
        """Have the plant do something; when it took effect, monotonic, ns.

        Raises:
            ProcessFailedError: It refused.
        """
        stamp, _, answer = self.parts.plant.ask(line, _ANSWERS_WITHIN_S).partition(" ")
        if answer != line:
            raise ProcessFailedError(f"the plant answered '{line}' with '{answer}'")
        return int(stamp)

    def misbehave(self) -> int:
        """Have the model misbehave; when it began, monotonic, ns.

        Raises:
            ProcessFailedError: It did not.
        """
        folder = self.file.parent
        (folder / "begin").touch()
        self.wait((folder / "begun").exists, "the model did not misbehave")
        return int((folder / "begun").read_text(encoding="ascii"))

    def wait_for(self, text: str, within_s: float = _STARTS_WITHIN_S) -> None:
        """Wait until node or guard have written a line with `text`.

        Raises:
            ProcessFailedError: They did not.
        """
        self.wait(lambda: any(text in line for line in self.lines), f"it never reported '{text}'", within_s)

    def wait(self, condition: Callable[[], object], what: str, within_s: float = _STARTS_WITHIN_S) -> None:
        """Wait for something.

        Raises:
            ProcessFailedError: It did not come.
        """
        deadline = time.monotonic() + within_s
        while not condition():
            if time.monotonic() > deadline:
                raise ProcessFailedError(f"{what}: {' | '.join(self.lines[-3:]) or 'it wrote nothing'}")
            time.sleep(_POLL_S)


class Starter:
    """Starts one robot after the other, each with a folder, a bus and a namespace of its own."""

    def __init__(self, place: Place) -> None:
        """Start robots there."""
        self._place = place
        self._numbers = itertools.count()

    @contextlib.contextmanager
    def __call__(self, arrangement: Arrangement) -> Iterator[Rig]:
        """A robot that runs, ready for its input.

        Raises:
            ProcessFailedError: It did not come to that.
        """
        number = next(self._numbers)
        folder = self._place.folder / str(number)
        folder.mkdir()
        file, namespace = folder / "robot.yaml", f"/robot_{number}"
        file.write_text(robot_text(self._place.robot, arrangement, folder), encoding="utf-8")
        bus = ["--interface", "local", "--channel", f"{self._place.channel}_{number}"]
        node = ["--ros", "--namespace", namespace] if arrangement.ros else ["--no-ros"]
        if arrangement.drives:
            node = _sequence(arrangement.drives_for_s, folder / "short.yaml") if arrangement.drives_for_s else []
        setup = DrillSetup(
            str(file), bus, serial=False, guard=arrangement.guard, stepped=False, folder=folder, node=node
        )
        with contextlib.ExitStack() as stack:
            parts = stack.enter_context(running(setup))
            ros = stack.enter_context(ros_client(namespace)) if arrangement.ros else None
            rig = Rig(arrangement, parts, file, namespace, ros)
            if arrangement.is_armed:
                wait_until_driven(parts, _DRIVEN_S)
                rig.wait(lambda: rig.state.posture == Posture.BALANCING, "the robot does not balance")
            else:
                rig.wait_for("runs at")
            if ros is not None:
                ros.wait_for_robot(_STARTS_WITHIN_S)
            yield rig


def _sequence(length_s: float, path: Path) -> list[str]:
    path.write_bytes(msgspec.yaml.encode(single_segment(0.3, 0.2, length_s)))
    return ["--no-ros", "--sequence", str(path)]


def robot_text(robot: str, arrangement: Arrangement, folder: Path) -> str:
    """The packaged robot file with its changes; a model that misbehaves is written beside it.

    Raises:
        RigError: What is to be changed does not stand there once.
    """
    source = load_robot(robot).model.source
    changes = list(arrangement.changes)
    if arrangement.on_request:
        changes.append(("arming: at_start", "arming: on_request"))
    if arrangement.model is not None:
        module, _, name = source.partition(":")
        words: Mapping[str, str] = {"once": arrangement.model.once, "always": arrangement.model.always}
        text = _MODEL.format(module=module, name=name, write=arrangement.model.write, **words)
        (folder / "misbehaving.py").write_text(text, encoding="utf-8")
        changes.append((f"source: {source}", "source: misbehaving:Misbehaving"))
    text = read_text(robot)
    for old, new in changes:
        if text.count(old) != 1:
            raise RigError(f"robot '{robot}' has '{old}' {text.count(old)} times, and not once")
        text = text.replace(old, new)
    return text

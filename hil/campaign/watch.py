# SPDX-License-Identifier: MIT
"""What is observed of one run: the node's modes and lines, what the drives give, and where the robot really is."""

import hashlib
import math
from array import array
from collections import deque
from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.hardware import Hardware
from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.hil.faults.fault import Injections
from segway_ecc.hil.rig.fronts import RecorderFront
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.node.cycle.cycle import BestEffortRecorder
from segway_ecc.node.cycle.interfaces import CycleRecord, NoRecorder, Recorder
from segway_ecc.node.safety.modes import Mode, Modes

Place = tuple[float, float]
_NOTHING = 1e-3
"""What is less, V or N m, is nothing: the current loop of a drive that is off only comes near zero."""
_LIES_RAD = 0.45
"""A body that leans as far lies on its bumper, which is at 0.5 rad, or is about to."""
_STANDS_RAD = 0.3
_SEVERITY = (Mode.ARMED, Mode.HOLD, Mode.DISARMED, Mode.FAULT)


class Change(NamedTuple):
    """What the robot noticed: when, ns after it was armed; the mode it entered, None where lines changed; and why."""

    at_ns: int
    mode: Mode | None
    reason: str


class DriveWatch:
    """Watches the simulated robot, tick by tick, from when it is armed on.

    `last_push_ns` is when a drive gave anything last, ns after it was armed; `max_tilt` the largest tilt either way,
    rad, None where the plant has none; `has_fallen` whether it has lain since it stood.
    """

    def __init__(self, robot: SimulatedRobot, injections: Injections) -> None:
        """Observe `robot`.

        Raises:
            PlantMismatchError: The plant does not report where the robot is.
        """
        self.way: list[Place] = []
        self.last_push_ns = -1
        self.is_pushing = self.has_fallen = self._has_stood = False
        names = robot.output_names
        lacking = [name for name in ("truth.x", "truth.y") if name not in names]
        if lacking:
            raise PlantMismatchError(f"a campaign needs the plant's output {' and '.join(lacking)}: where the robot is")
        self._truth = itemgetter(*(place for place, name in enumerate(names) if name.startswith("truth.")))
        self._place = itemgetter(names.index("truth.x"), names.index("truth.y"))
        self._pitch = names.index("truth.pitch") if "truth.pitch" in names else None
        self.max_tilt = None if self._pitch is None else 0.0
        self._robot = robot
        self._timeline = injections.timeline
        self._values = array("d")

    def look(self, outputs: Sequence[float]) -> None:
        """Observe one tick, with the plant's outputs after it."""
        given = self._robot.inputs
        self._values.extend(given)
        self._values.extend(self._truth(outputs))
        elapsed_ns = self._timeline.elapsed_ns
        if elapsed_ns < 0:
            return
        self.way.append(self._place(outputs))
        self.is_pushing = True in [abs(value) > _NOTHING for value in given]  # any() takes longer
        if self.is_pushing:
            self.last_push_ns = elapsed_ns
        if self._pitch is not None:
            tilt = abs(outputs[self._pitch])
            if self.max_tilt is None or tilt > self.max_tilt:  # max() takes longer
                self.max_tilt = tilt
            self._has_stood = self._has_stood or tilt < _STANDS_RAD
            self.has_fallen = self.has_fallen or (self._has_stood and tilt > _LIES_RAD)

    @property
    def digest(self) -> str:
        """A digest over everything that the drives gave, and all truth, of every tick since power-on."""
        return hashlib.blake2b(self._values.tobytes(), digest_size=16).hexdigest()


class NodeWatch(RecorderFront):
    """Observes the node, cycle by cycle, and passes each record on to a recorder; see `Recorder`.

    A recorder that fails is done without, as the loop does: the observation goes on. It keeps the changes of mode and
    of lines, oldest first, and the newest posture, empty for none; `modes` are the robot's, from its loop.
    """

    def __init__(self, injections: Injections, hardware: Hardware, recorder: Recorder | None = None) -> None:
        """Watch a node with this hardware."""
        self.changes: list[Change] = []
        self.mode = Mode.DISARMED
        self.posture = ""
        self._timeline = injections.timeline
        self.events: deque[str] = deque(maxlen=1)
        super().__init__(BestEffortRecorder(recorder or NoRecorder(), self.events))
        self._switching = hardware.switching if isinstance(hardware, Assembly) else None
        self._switches = 0
        self.modes: Modes | None = None

    def write(self, record: CycleRecord) -> None:
        """Observe one cycle, and pass it on."""
        mode, switching = record.mode, self._switching
        if record.posture is not None:
            self.posture = str(record.posture.posture)
        if mode is Mode.ARMED:
            self._timeline.start()
        if self._timeline.started_ns is not None:
            elapsed_ns = self._timeline.elapsed_ns
            if mode is not self.mode:
                self.changes.append(Change(elapsed_ns, mode, "" if self.modes is None else self.modes.reason))
                self.mode = mode
            if switching is not None and switching.count > self._switches:
                self._switches = switching.count
                self.changes.append(Change(elapsed_ns, None, switching.switches[-1].reason))
        super().write(record)

    def worst_since(self, since_ns: int) -> Mode:
        """The most severe mode there has been, in ns after it was armed, since then."""
        modes = [change.mode for change in self.changes if change.at_ns >= since_ns and change.mode is not None]
        return max([*modes, self.mode], key=_SEVERITY.index)


def apart(a: Sequence[Place], b: Sequence[Place]) -> float:
    """The largest distance between places at the same times, as long as both last; m."""
    return max((math.dist(p, q) for p, q in zip(a, b, strict=False)), default=0.0)

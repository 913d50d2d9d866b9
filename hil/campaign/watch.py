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
    """Watches the simulated robot, tick by tick: what it sees is kept, and looked through when it is asked for."""

    def __init__(self, robot: SimulatedRobot, injections: Injections) -> None:
        """Observe `robot`.

        Raises:
            PlantMismatchError: The plant does not report where the robot is.
        """
        names = robot.output_names
        lacking = [name for name in ("truth.x", "truth.y") if name not in names]
        if lacking:
            raise PlantMismatchError(f"a campaign needs the plant's output {' and '.join(lacking)}: where the robot is")
        places = [place for place, name in enumerate(names) if name.startswith("truth.")]
        self._truth = itemgetter(*places)
        self._given = len(robot.inputs)
        kept = [names[place] for place in places]
        self._x, self._y, self._pitch = (
            self._given + kept.index(name) if name in kept else None for name in ("truth.x", "truth.y", "truth.pitch")
        )
        self._width = self._given + len(kept)
        self._robot = robot
        self._timeline = injections.timeline
        self._values = array("d")
        """Of each tick since power-on, what the drives gave and all truth."""
        self._armed: tuple[int, int] | None = None
        """Of the first tick since the robot was armed, its number and how long after that it was, ns."""

    def look(self, outputs: Sequence[float]) -> None:
        """Observe one tick, with the plant's outputs after it; to be called after each, which are all as long."""
        self._values.extend((*self._robot.inputs, *self._truth(outputs)))
        if self._armed is None and self._timeline.started_ns is not None:
            self._armed = len(self._values) // self._width - 1, self._timeline.elapsed_ns

    @property
    def way(self) -> list[Place]:
        """Where the robot is at each tick since it was armed, m."""
        return list(zip(self._since_armed(self._x), self._since_armed(self._y), strict=True))

    @property
    def max_tilt(self) -> float | None:
        """The largest tilt either way since the robot was armed, rad; None where the plant has none."""
        return None if self._pitch is None else max([0.0, *map(abs, self._since_armed(self._pitch))])

    @property
    def has_fallen(self) -> bool:
        """Whether the robot has lain since it stood."""
        tilts = list(map(abs, self._since_armed(self._pitch)))
        stood = next((place for place, tilt in enumerate(tilts) if tilt < _STANDS_RAD), len(tilts))
        return any(tilt > _LIES_RAD for tilt in tilts[stood:])

    @property
    def is_pushing(self) -> bool:
        """Whether a drive gives anything at the newest tick."""
        return self.last_push_ns >= 0 and self._pushes(len(self._values) // self._width - 1)

    @property
    def last_push_ns(self) -> int:
        """When a drive gave anything last, ns after the robot was armed; -1 where none did."""
        if self._armed is None:
            return -1
        armed, elapsed_ns = self._armed
        newest = len(self._values) // self._width - 1
        last = next((tick for tick in range(newest, armed - 1, -1) if self._pushes(tick)), None)
        return -1 if last is None else elapsed_ns + (last - armed) * self._robot.tick_ns

    @property
    def digest(self) -> str:
        """A digest over everything that the drives gave, and all truth, of every tick since power-on."""
        return hashlib.blake2b(self._values.tobytes(), digest_size=16).hexdigest()

    def _since_armed(self, column: int | None) -> Sequence[float]:
        if self._armed is None or column is None:
            return ()
        return self._values[self._armed[0] * self._width + column :: self._width]

    def _pushes(self, tick: int) -> bool:
        begin = tick * self._width
        return any(abs(value) > _NOTHING for value in self._values[begin : begin + self._given])


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
    return max(map(math.dist, a, b), default=0.0)

# SPDX-License-Identifier: MIT
"""Stand-ins to test a model or a robot with: scripted time, hardware that records, a scripted world.

Everything runs in one thread and in simulated time, so a test takes no longer than its arithmetic:

    bench = Bench(MyModel(), RecordingHardware({"left.velocity": "rad/s"}, {"left.voltage": "V"}, (30.0,)), wiring)
    bench.stage.send_setpoint(3, Setpoint(1.0, 0.0))
    bench.loop.run(cycles=100)
    assert bench.hardware.sent[50] == (24.0,)

And what tries a drive family with its simulated drives: `check_conformance`.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from msgspec.structs import replace

from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.firmware_io.errors import ArmingRefusedError
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.hil.conformance.kit import CONFORMANCE_ASPECTS, check_conformance
from segway_ecc.hil.conformance.rig import NonconformanceError
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.devices.family import SimulatedDrives
from segway_ecc.node.cycle.cycle import Cycle
from segway_ecc.node.cycle.interfaces import (
    CycleRecord,
    Heartbeat,
    Inbox,
    Report,
    Request,
    SetValue,
    StampedSetpoint,
    VariableWrite,
)
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.cycle.setpoints import NO_LIMIT, Setpoint, SetpointSchedule
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.timing import TimeBase
from segway_ecc.node.cycle.trajectory import Trajectory, TrajectoryFollower
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.model.declared import declared_variables
from segway_ecc.node.model.model import Model
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.safety.modes import Action, Answer
from segway_ecc.node.safety.settings import SafetySettings, StationSettings

__all__ = [
    "CONFORMANCE_ASPECTS",
    "START_NS",
    "WALL_START_NS",
    "Bench",
    "Device",
    "KeepingRecorder",
    "NonconformanceError",
    "RecordingHardware",
    "ScriptedClock",
    "ScriptedStage",
    "SetpointLimits",
    "SimulatedDrives",
    "check_conformance",
]

START_NS: Final = 1_000_000_000
"""What a scripted clock reads at first, monotonic."""

WALL_START_NS: Final = 1_700_000_000_000_000_000
"""What the wall clock of a scripted clock reads then."""


class ScriptedClock:
    """A clock that stands still, but for what is waited for and what a script spends.

    Attributes:
        events: What happens as the n-th wait (0 is the first) ends, before anybody goes on.
        late_ns: How much later than asked the n-th wait ends, ns.
        woken_ns: When each wait ended, monotonic.
    """

    def __init__(self) -> None:
        """Start at `START_NS`."""
        self.events: dict[int, Callable[[], object]] = {}
        self.late_ns: dict[int, int] = {}
        self.woken_ns: list[int] = []
        self._now_ns = START_NS
        self._wall_offset_ns = WALL_START_NS - START_NS

    def now_ns(self) -> int:
        """Scripted monotonic time."""
        return self._now_ns

    def wall_ns(self) -> int:
        """Scripted wall-clock time."""
        return self._now_ns + self._wall_offset_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Pass to the deadline, if it has not passed, and as much further as the script has it."""
        wait = len(self.woken_ns)
        self._now_ns = max(self._now_ns, deadline_ns) + self.late_ns.get(wait, 0)
        self.woken_ns.append(self._now_ns)
        self.events.get(wait, _nothing)()

    def spend(self, duration_ns: int) -> None:
        """Let time pass, ns."""
        self._now_ns += duration_ns

    def jump_wall(self, step_ns: int) -> None:
        """Set the wall clock forward, or back, ns."""
        self._wall_offset_ns += step_ns


class RecordingHardware:
    """Hardware that measures what it is given and records its commands; see `Hardware`.

    Attributes:
        measured: The next snapshot.
        reasons: What speaks against arming.
        raises: The exception that a method raises, by the method's name.
        health: What diagnostics show.
        journal: The methods called, in order, `exchange` only where it sent something.
        sent: Every command that was sent, in order.
        armed: Whether commands reach the motors.
    """

    def __init__(
        self,
        signals: Mapping[str, str],
        commands: Mapping[str, str],
        limits: Sequence[float],
        journal: list[str] | None = None,
    ) -> None:
        """Measure zero for each of `signals`, all fresh; a shared `journal` shows the order among several parts."""
        self.signals = signals
        self.commands = commands
        self.limits = limits
        self.measured = Sensors((0.0,) * len(signals), (0.0,) * len(signals), (True,) * len(signals))
        self.reasons: Sequence[str] = ()
        self.raises: dict[str, Exception] = {}
        self.health: dict[str, str] = {}
        self.journal = [] if journal is None else journal
        self.sent: list[tuple[float, ...]] = []
        self.armed = False

    def open(self) -> None:
        """Note it."""
        self._called("open")

    def exchange(self, commands: Sequence[float] | None) -> Sensors:
        """Note what is sent; return `measured`."""
        if commands is not None:
            self.sent.append(tuple(commands))
            self._called("exchange")
        elif "exchange" in self.raises:
            raise self.raises["exchange"]
        return self.measured

    def arm(self) -> None:
        """Arm, unless there are `reasons`."""
        self._called("arm")
        if self.reasons:
            raise ArmingRefusedError(self.reasons)
        self.armed = True

    def arming_failures(self) -> Sequence[str]:
        """What speaks against arming."""
        return self.reasons

    def disarm(self) -> None:
        """Disarm."""
        self.armed = False
        self._called("disarm")

    def close(self) -> None:
        """Disarm, and note it."""
        self.armed = False
        self._called("close")

    def _called(self, method: str) -> None:
        self.journal.append(method)
        if method in self.raises:
            raise self.raises[method]


class ScriptedStage:
    """A world whose set-points, requests and heartbeats are scripted; see `Stage`.

    Attributes:
        costs_ns: How long the ROS stage of the n-th cycle takes, ns.
        over_after: The cycle after which the world is over, if any, and why.
        answers: The answers to everything asked, in order.
        write_answers: Why each write was refused, in order; empty where it was not.
        reports: What was published.
        diagnostics: The diagnostics published, with their stamps.
        looks: How often background work was asked for.
        journal: The methods called in each cycle, in order.
        wants_reports: Whether reports are made.
    """

    wants_reports = True

    def __init__(self, clock: ScriptedClock, journal: list[str] | None = None) -> None:
        """Take time from `clock`; a shared `journal` shows the order among several parts."""
        self.costs_ns: dict[int, int] = {}
        self.over_after: tuple[int, str] | None = None
        self.answers: list[Answer] = []
        self.write_answers: list[str] = []
        self.reports: list[Report] = []
        self.diagnostics: list[tuple[int, Sequence[DiagnosticStatus]]] = []
        self.looks = 0
        self.journal = [] if journal is None else journal
        self._clock = clock
        self._inboxes: defaultdict[int, Inbox] = defaultdict(Inbox)
        self._cycle = -1

    @property
    def over(self) -> str | None:
        """Whether the script has ended."""
        if self.over_after is None or self._cycle < self.over_after[0]:
            return None
        return self.over_after[1]

    def send_setpoint(self, cycle: int, setpoint: Setpoint, stamp_ns: int | None = None) -> None:
        """Let a set-point arrive in a cycle, for then or for a stamp, ns since the Unix epoch."""
        self._inboxes[cycle].setpoints.append(StampedSetpoint(setpoint, stamp_ns))

    def send_trajectory(self, cycle: int, trajectory: Trajectory) -> None:
        """Let a whole manoeuvre arrive in a cycle."""
        self._inboxes[cycle].trajectories.append(trajectory)

    def send_write(self, cycle: int, values: Mapping[str, float]) -> None:
        """Let variables be written in a cycle, together or not at all; `write_answers` has why they were refused."""
        self._inboxes[cycle].writes.append(VariableWrite(tuple(values.items()), self.write_answers.append))

    def send_request(self, cycle: int, action: Action) -> None:
        """Let a request arrive in a cycle."""
        self._inboxes[cycle].requests.append(Request(action, self.answers.append))

    def send_heartbeat(self, cycle: int, station: str = "base", stamp_ns: int = 0) -> None:
        """Let a base station's heartbeat arrive in a cycle."""
        self._inboxes[cycle].stations.append(Heartbeat(station, stamp_ns))

    def introduce_station(self, cycle: int, station: str = "base") -> None:
        """Let a base station introduce itself in a cycle: its heartbeats count from then on."""
        self._inboxes[cycle].introductions.append(station)

    def set_value(self, cycle: int, place: int, value: float) -> None:
        """Let a value be set in a cycle: its place in the wiring's `set_names`, and what it is to be."""
        self._inboxes[cycle].values.append(SetValue(place, value))

    def take_inbox(self) -> Inbox:
        """What the script holds for this cycle."""
        self.journal.append("take")
        self._cycle += 1
        self._clock.spend(self.costs_ns.get(self._cycle, 0))
        return self._inboxes.pop(self._cycle, Inbox())

    def publish(self, report: Report) -> None:
        """Keep the report."""
        self.journal.append("publish")
        self.reports.append(report)

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep the diagnostics."""
        self.diagnostics.append((stamp_ns, statuses))

    def do_background_work(self) -> None:
        """Count it."""
        self.looks += 1

    def close(self) -> None:
        """Note it."""
        self.journal.append("stage closed")


class KeepingRecorder:
    """A recorder that keeps everything in memory; see `Recorder`.

    Attributes:
        records: The cycles.
        diagnostics: The diagnostics, with their stamps.
        journal: Notes when it is closed.
    """

    def __init__(self, journal: list[str] | None = None) -> None:
        """Keep nothing yet; a shared `journal` shows the order among several parts."""
        self.records: list[CycleRecord] = []
        self.diagnostics: list[tuple[int, Sequence[DiagnosticStatus]]] = []
        self.journal = [] if journal is None else journal

    def write(self, record: CycleRecord) -> None:
        """Keep a cycle, with copies of what may change."""
        self.records.append(replace(record, u=tuple(record.u), y=tuple(record.y), commands=tuple(record.commands)))

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep diagnostics."""
        self.diagnostics.append((stamp_ns, statuses))

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Keep no snapshot."""

    def close(self) -> None:
        """Note it."""
        self.journal.append("recorder closed")


class SetpointLimits(NamedTuple):
    """The limits of a set-point schedule, in cycles; see `SetpointSchedule`."""

    timeout: int = 50
    tolerance: int = 10
    horizon: int = 3000


class Bench:
    """A model and hardware in a loop of their own, with scripted time and a scripted world.

    Attributes:
        clock: The time.
        stage: The world.
        recorder: What was recorded.
        model: The model.
        hardware: The hardware.
        cycle: The cycle.
        loop: The loop, to be run.
        journal: What the hardware, the stage and the recorder were called for, in order.
    """

    def __init__(  # noqa: PLR0913 - what a robot file says, each with the value that most tests want
        self,
        model: Model,
        hardware: RecordingHardware,
        wiring: Mapping[str, str],
        *,
        arm_at_start: bool = True,
        actuate_immediately: bool = False,
        setpoints: SetpointLimits | None = None,
        safety: SafetySettings | None = None,
        station: StationSettings | None = None,
    ) -> None:
        """Join a model to hardware; the hardware's journal becomes that of the bench."""
        self.journal = hardware.journal
        self.clock = ScriptedClock()
        self.stage = ScriptedStage(self.clock, self.journal)
        self.recorder = KeepingRecorder(self.journal)
        self.model = model
        self.hardware = hardware
        self.period_ns = round(model.step_size * NS_PER_S)
        limits, time_base = setpoints or SetpointLimits(), TimeBase(self.period_ns)
        self.cycle = Cycle(
            model=model,
            writer=VariableWriter(model, declared_variables(model)),
            hardware=hardware,
            wiring=wire(model, hardware, wiring),
            schedule=SetpointSchedule(*limits),
            trajectories=TrajectoryFollower(time_base, NO_LIMIT, limits.horizon),
            time_base=time_base,
            clock=self.clock,
            stage=self.stage,
            recorder=self.recorder,
            arm_at_start=arm_at_start,
            actuate_immediately=actuate_immediately,
            safety=safety,
            station=station,
        )
        self.loop = Loop(
            cycle=self.cycle,
            clock=self.clock,
            stage=self.stage,
            period_ns=self.period_ns,
            robot_name="bench",
        )


def _nothing() -> None:
    """Let nothing happen."""

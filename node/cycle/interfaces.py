# SPDX-License-Identifier: MIT
"""The cycle's interfaces to the ROS stage and the recorder, so that it depends on neither."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, Protocol

import msgspec

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.trajectory import Trajectory, TrajectoryState, TrajectoryStatus
from segway_ecc.node.safety.modes import Action, Answer, Mode
from segway_ecc.node.safety.posture import Posture


class StampedSetpoint(NamedTuple):
    """A set-point with the time it is for, ns since the Unix epoch; None means now."""

    setpoint: Setpoint
    stamp_ns: int | None


class SetValue(NamedTuple):
    """A value that somebody set: its place in the wiring's `set_names`, and what it is to be."""

    place: int
    value: float


class Heartbeat(NamedTuple):
    """A base station's sign of life: its name, and its own clock, ns, which means nothing here and is only echoed."""

    station: str
    stamp_ns: int


class Request(NamedTuple):
    """Something an operator asks, and where the answer goes."""

    action: Action
    answer: Callable[[Answer], None]


class VariableWrite(NamedTuple):
    """Parameters or states of the model that are to be written together, or not at all; see `VariableWriter`.

    Attributes:
        values: Their names, each with what it is to be, in its unit.
        answer: Called with why it was refused; empty where it was not.
    """

    values: Sequence[tuple[str, float]]
    answer: Callable[[str], None]


class Written(NamedTuple):
    """A variable that was written between the cycle before and this one.

    One that was refused is kept too: a replay tries it again, and has to refuse it again.

    Attributes:
        value: In the variable's unit.
        refusal: Why it was refused; empty where it was not.
        has_more: Whether the one that follows was written together with it.
    """

    name: str
    value: float
    refusal: str = ""
    has_more: bool = False


def written_of(values: Sequence[tuple[str, float]], refusal: str = "") -> list[Written]:
    """What is recorded of variables that were written together, or refused."""
    last = len(values) - 1
    return [Written(name, value, refusal, place < last) for place, (name, value) in enumerate(values)]


MODEL_CALL: Final = "model"
"""The call that the model's own equations failed in: the run ends with that cycle."""
UNSEEN_CALL: Final = "unseen"
"""Not what the hardware has against arming, but the signals that it measures only once the motors are on."""


class HardwareAnswer(NamedTuple):
    """What the hardware answered where that decides: which call it was, and what it had against it.

    The last answer of a run whose model failed is the model's; see `MODEL_CALL`.
    """

    call: str
    reasons: tuple[str, ...]


class PostureChange(NamedTuple):
    """A posture that was entered, and why, where it is FALLEN."""

    posture: Posture
    reason: str


class Inbox(msgspec.Struct):
    """What arrived from outside since the last cycle."""

    setpoints: list[StampedSetpoint] = []
    values: list[SetValue] = []
    requests: list[Request] = []
    writes: list[VariableWrite] = []
    """Those that the cycle is to carry out; it puts what came of them into `written`, and records that."""
    written: list[Written] = []
    stations: list[Heartbeat] = []
    """The newest is the last."""
    trajectories: list[Trajectory] = []
    introductions: list[str] = []
    """Names of base stations that are to watch over the robot from now on."""


class Report(msgspec.Struct, frozen=True, array_like=True):
    """What is published of a cycle.

    Attributes:
        stamp_ns: The cycle's stamp, ns since the Unix epoch.
        mode: What the robot is allowed to do.
        values: The published signals, in the order of the wiring.
        applied: The set-point that came into force in the cycle before, with that cycle's stamp; None if none did.
        topics: Values of the variables that are published one by one, in the order of the wiring.
        reason: Why the robot is in that mode.
        cycle: The number of the cycle.
        drives: `on` where every motor follows commands, `off` where every drive reports its motors off,
            else `unconfirmed`; `none` where there are none.
        is_zero: Whether the commands that left last were all zero.
        heartbeat: The newest of a base station, of each in turn where there are several; None before the first.
        heartbeat_age_ns: How long ago it was received, ns.
        set_values: What anybody may set, as it is in force, in the order of the wiring.
        at_ns: When it was made, monotonic, ns.
        trajectory: The newest trajectory that was accepted, and what became of it.
        refused_trajectory: One that was refused; each of them is in one report.
        is_introduced: Whether the station of `heartbeat` watches over the robot: its heartbeats count.
        posture: Of a robot that has one.
        residual: Of a robot whose acceleration is compared with what was designed: the residual, N, and what is
            estimated from it; see `ResidualMonitor.values`.
    """

    stamp_ns: int
    mode: Mode
    values: Sequence[float]
    applied: StampedSetpoint | None
    topics: Sequence[float] = ()
    reason: str = ""
    cycle: int = 0
    drives: str = "none"
    is_zero: bool = True
    heartbeat: Heartbeat | None = None
    heartbeat_age_ns: int = 0
    set_values: Sequence[float] = ()
    at_ns: int = 0
    trajectory: TrajectoryStatus = TrajectoryStatus(0, TrajectoryState.NONE, "", 0, 0)
    refused_trajectory: TrajectoryStatus | None = None
    is_introduced: bool = False
    posture: Posture | None = None
    residual: tuple[float, ...] = ()


class Stage(Protocol):
    """The world outside: takes what has arrived, publishes the state. Nothing here waits.

    An implementation that builds on `NoStage` writes `take_inbox` and `publish`; the rest has its default there.
    """

    @property
    def over(self) -> str | None:
        """Why the world outside has ended, which ends the loop; None while it goes on."""

    @property
    def wants_reports(self) -> bool:
        """Whether anybody subscribes to what is published of each cycle; no report is made of a cycle where not."""

    def take_inbox(self) -> Inbox:
        """What has arrived since the last call."""

    def publish(self, report: Report) -> None:
        """Publish this cycle's state; see `wants_reports`."""

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Publish diagnostics; called in the slack of a cycle about once a second."""

    def do_background_work(self) -> None:
        """Do one small piece of what is slow; called in the slack of a cycle."""

    def close(self) -> None:
        """Leave."""


PHASES: Final = ("exchange", "ros", "decide", "equations", "limit", "record")
"""The parts of a cycle, in their order."""


class CycleRecord(msgspec.Struct, frozen=True, array_like=True):
    """Everything about one cycle.

    Durations are in ns and in the order of `PHASES`; the other sequences are in the order of the
    hardware's signals, the model's ports and the hardware's commands.

    Attributes:
        start_ns: When the cycle started, ns, monotonic.
        inbox: What arrived in it; None for nothing.
        answers: What the hardware answered, in order.
        initial: The snapshot that the model started from, in the first cycle only.
        posture: The posture that was entered in it, of a robot that has one; None where it stayed.
        warning: What the residual monitor began or ceased to warn of in it, of a robot that has one.
    """

    cycle: int
    stamp_ns: int
    mode: Mode
    lateness_ns: int
    sensors: Sensors
    setpoint: Setpoint
    u: Sequence[float]
    y: Sequence[float]
    commands: Sequence[float]
    published: Sequence[float]
    durations_ns: Sequence[int]
    start_ns: int = 0
    inbox: Inbox | None = None
    answers: Sequence[HardwareAnswer] = ()
    initial: Sensors | None = None
    posture: PostureChange | None = None
    warning: str | None = None


class Recorder(Protocol):
    """Keeps cycles. `write` never blocks; what it cannot keep it counts."""

    def write(self, record: CycleRecord) -> None:
        """Keep one cycle."""

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep a set of diagnostics."""

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Keep what all later cycles depend on, about once a second in the slack; `take` is called by who keeps it."""

    def close(self) -> None:
        """Finish the log."""


class NoStage:
    """A stage without a world: nothing arrives, nobody subscribes. A base for stages."""

    over: str | None = None

    @property
    def wants_reports(self) -> bool:
        """Whether it is a stage that builds on this one and publishes reports."""
        return type(self).publish is not NoStage.publish

    def take_inbox(self) -> Inbox:
        """Nothing ever arrives."""
        return Inbox()

    def publish(self, report: Report) -> None:
        """Nobody listens."""

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Nobody listens."""

    def do_background_work(self) -> None:
        """There is nothing to see."""

    def close(self) -> None:
        """There is nothing to leave."""


class NoRecorder:
    """A recorder that keeps nothing."""

    def write(self, record: CycleRecord) -> None:
        """Discard it."""

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Discard them."""

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Nothing is taken."""

    def close(self) -> None:
        """There is nothing to finish."""

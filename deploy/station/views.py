# SPDX-License-Identifier: MIT
"""What the station sends to the page and prints with `status`, and what the page sends; every struct is JSON."""

import enum
from collections.abc import Mapping, Sequence
from typing import Protocol

import msgspec


@enum.unique
class Act(enum.StrEnum):
    """What an operator can command."""

    STOP = "stop"
    """Torque off, latched until cleared; of a robot that was not found yet, as soon as it is."""
    CANCEL_STOP = "cancel_stop"
    """Take back a stop that is not confirmed."""
    CLEAR_FAULT = "clear_fault"
    ARM = "arm"
    DISARM = "disarm"
    STAND = "stand"
    SIT = "sit"
    TAKE_CONTROL = "take_control"
    """Become the one who commands, in place of whoever does."""
    RELEASE_CONTROL = "release_control"
    DISMISS = "dismiss"
    """Forget a robot that is lost; it is found again as soon as it is heard."""
    PLAY = "play"
    """Play a sequence, whose text is the command's `text`."""
    BREAK_OFF = "break_off"
    """End the sequence that is being played."""
    TRY = "try"
    """Do to a simulated robot what the trial does that the command's `name` names; see `TrialView`."""


class SequenceView(msgspec.Struct, frozen=True, kw_only=True):
    """A sequence that is played, or was last.

    Attributes:
        fraction: How much of it has passed, 0 to 1.
        state: `waiting`, `running`, `done`, `broken off`, `failed`.
        reason: Why it ended, where it did not end by itself.
        path: Where it leads from where it began, x and y, m; empty before it begins and after it ended.
    """

    name: str
    fraction: float
    state: str
    reason: str = ""
    path: Sequence[tuple[float, float]] = ()


class RobotView(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of a robot; None is what it does not report.

    Attributes:
        robot: Its namespace, which names it: `/` or `/alice`.
        name: Its name in the robot file.
        is_alive: Whether its `mode` was received within the last second.
        age_s: Since its last `mode`, s.
        round_trip_s: From our heartbeat to the robot's echo of it, s.
        mode: DISARMED, ARMED, HOLD, FAULT.
        drives: `on`, `off`, `unconfirmed` where not every drive reports that it is off, or `none` where it has none.
        is_zero: Whether the commands of its newest cycle were all zero.
        stop: Empty, `requested`, or `confirmed`: in FAULT, with drives that report off, or with no drives and zero.
        stop_kept: Whether a requested stop is on the station's disk: one that starts again delivers it.
        stop_after_s: From our request to that confirmation, s.
        pitch: Forward lean, rad.
        linear_velocity: m/s.
        angular_velocity: rad/s.
        linear_setpoint: m/s.
        angular_setpoint: rad/s.
        x: m.
        y: m.
        heading: rad.
        supply_v: Battery, V.
        checklist: The pre-arm checks by name: why each fails, or `ok`.
        links: Health of each link, by name: `state`, frames, errors, load and so on, as in its diagnostics.
        timing: Rate, deadlines and percentiles of the phases, as in its diagnostics.
        controller: Who commands it from this station, or empty.
        posture: What a robot that stands up and sits down by command is doing; empty for any other.
        tilt_limit_rad: Beyond that tilt from upright its safety takes the torque away, rad.
        down_rad: Beyond that tilt a robot that balances counts as fallen, after a while, rad.
    """

    robot: str
    name: str = ""
    is_alive: bool = False
    age_s: float = 0.0
    round_trip_s: float | None = None
    mode: str = ""
    reason: str = ""
    drives: str = ""
    is_zero: bool | None = None
    stop: str = ""
    stop_kept: bool = False
    stop_after_s: float | None = None
    pitch: float | None = None
    linear_velocity: float | None = None
    angular_velocity: float | None = None
    linear_setpoint: float | None = None
    angular_setpoint: float | None = None
    x: float | None = None
    y: float | None = None
    heading: float | None = None
    supply_v: float | None = None
    checklist: Mapping[str, str] = msgspec.field(default_factory=dict)
    links: Mapping[str, Mapping[str, str]] = msgspec.field(default_factory=dict)
    timing: Mapping[str, str] = msgspec.field(default_factory=dict)
    controller: str = ""
    sequence: SequenceView | None = None
    can_stand: bool = False
    posture: str = ""
    tilt_limit_rad: float | None = None
    down_rad: float | None = None


class FleetView(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="fleet"):
    """Every robot that was found and not dismissed since the station began, or that is to be stopped; by namespace.

    `time_s` is the station's monotonic clock, s: a picture whose time does not advance is stale.
    """

    time_s: float
    robots: Sequence[RobotView]

    @property
    def is_settled(self) -> bool:
        """Whether there are robots, and each that still publishes has sent all that it publishes once a second."""
        return bool(self.robots) and all(robot.timing or not robot.is_alive for robot in self.robots)


class EventView(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="event"):
    """Something that happened.

    Attributes:
        number: Counts up from 1.
        wall_ns: When, ns since the Unix epoch, by the station's clock.
        robot: Which robot; empty for the station itself.
        level: `info`, `warning` or `error`.
        who: Whose command it was, or empty.
    """

    number: int
    wall_ns: int
    robot: str
    text: str
    level: str = "info"
    who: str = ""


class FleetStatus(Protocol):
    """The robots as the station knows them; nothing of it waits."""

    def fleet(self) -> FleetView:
        """The newest picture."""

    def events(self, after: int) -> Sequence[EventView]:
        """The events that are kept and whose number is greater than `after`."""

    def refused(self) -> Mapping[str, int]:
        """What the station itself refused, by cause."""


class ReplyView(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="reply"):
    """What came of a command: whether the robot confirmed it, and its answer or why it failed."""

    id: int
    is_accepted: bool
    text: str


class SeenView(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="seen"):
    """When the page's word that it has a picture arrived: by then the page had it, which bounds how old it was.

    Attributes:
        time_s: Of the picture, as in `FleetView`.
        at_s: When the page's message arrived, by the same clock, s.
    """

    time_s: float
    at_s: float


class TrialView(msgspec.Struct, frozen=True, kw_only=True):
    """Something that can be done to a simulated robot, to see what its safety does.

    Attributes:
        name: By which a command names it.
        title: What its button says.
        effect: What it does, in one sentence.
    """

    name: str
    title: str
    effect: str


class HelloView(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="hello"):
    """The first message of a socket.

    Attributes:
        who: The operator's name.
        role: `viewer` or `operator`.
        drive_period_s: How often a driving browser is to send, s.
        max_linear: The fastest that the page may request, m/s.
        max_angular: The same for turning, rad/s.
        fresh_s: A picture that is older is too old to act on, s.
        trials: What can be done to the robot; nothing to a real one.
    """

    who: str
    role: str
    version: str
    drive_period_s: float
    max_linear: float
    max_angular: float
    fresh_s: float
    trials: Sequence[TrialView] = ()


class Seen(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="seen", forbid_unknown_fields=True):
    """The page has a picture, and all before it: the station sends the next one when it knows.

    It has no id: sent again, or for a picture that was never sent, it changes nothing.

    Attributes:
        time_s: Of the picture, as in `FleetView`.
    """

    time_s: float


class Command(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="command", forbid_unknown_fields=True):
    """A command of the page.

    The id counts up within a socket; one that does not is refused, as a replayed one. For `play`, the text is the
    sequence, as YAML, and the name what to call it.
    """

    id: int
    robot: str
    act: Act
    text: str = ""
    name: str = ""


class Drive(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="drive", forbid_unknown_fields=True):
    """What the page sends again and again while somebody drives, and once with zeros as soon as nobody does.

    Attributes:
        id: Counts up with those of the commands.
        linear: m/s.
        angular: rad/s.
    """

    id: int
    robot: str
    linear: float
    angular: float

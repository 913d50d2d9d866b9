# SPDX-License-Identifier: MIT
"""What passes between the loop and the ROS process: its settings as JSON, then MessagePack in two rings."""

import enum
from collections.abc import Sequence
from typing import Final, NamedTuple

import msgspec

from segway_ecc.node.config import RosSection
from segway_ecc.node.cycle.interfaces import Heartbeat, Report, SetValue, StampedSetpoint
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.trajectory import TimedSetpoint
from segway_ecc.node.model.model import Variable
from segway_ecc.node.ring import slots_for
from segway_ecc.node.safety.modes import Action, Answer

WATCH_TOPIC: Final = "watch"
"""Where a base station introduces itself."""
WATCH_TYPE: Final = "std_msgs/msg/String"
USE_SIM_TIME: Final = "use_sim_time"
"""The parameter that every ROS node has: whether its time is that of `/clock`."""
NO_SIM_TIME: Final = (
    f"'{USE_SIM_TIME}' must be false: this robot runs by its machine's clock; simulate it by one of its own, which it "
    "publishes on /clock, with segway-ecc lock-step ROBOT"
)
SIM_TIME: Final = f"'{USE_SIM_TIME}' must be true: this robot is simulated, and runs by the time that is on /clock"
_NUMBER_BYTES: Final = 9
"""Of MessagePack, at most."""
_REPORTS: Final = 64
"""Cycles that the process may fall behind."""
_REPORT_BYTES: Final = 2304
"""All else of a report, and as much as it needs of diagnostics."""


@enum.unique
class FromLoop(enum.IntEnum):
    """Kinds of messages from the loop."""

    REPORT = 1
    STATUS = 2
    """One status of a set of diagnostics."""
    DIAGNOSTICS = 3
    """The statuses that went before are a set; the body is its stamp."""
    ANSWER = 4
    WRITTEN = 5
    END = 6
    CLOCK = 7
    """Simulated time is published; the body is its stamp. What was reported before has been published by then."""


@enum.unique
class ToLoop(enum.IntEnum):
    """Kinds of messages to the loop."""

    INBOX = 1
    WRITE = 2
    SUBSCRIBED = 3
    """Whether anybody subscribes to what is published of each cycle."""
    TRAJECTORY = 4
    """A part of a trajectory."""
    STRANGER = 5
    """Who else publishes one of the robot's topics, in one line; each is sent once."""
    REFUSED = 6
    """There was a message that can never fit into the ring."""


class NumberedRequest(NamedTuple):
    """A request, and the number that its answer bears."""

    action: Action
    number: int


class InboxMessage(NamedTuple):
    """What arrived from outside; see `segway_ecc.node.cycle.interfaces.Inbox`."""

    setpoints: list[StampedSetpoint]
    values: list[SetValue]
    stations: list[Heartbeat]
    requests: list[NumberedRequest]
    introductions: list[str]


class TrajectoryPart(NamedTuple):
    """Some points of a trajectory, from `begin` on, of `total`; the loop has it once all are there."""

    stamp_ns: int
    points: Sequence[TimedSetpoint]
    begin: int
    total: int
    unsupported: str = ""


class NumberedAnswer(NamedTuple):
    """The answer to a request."""

    number: int
    answer: Answer


class WriteRequest(NamedTuple):
    """Parameters that are to be written together, and the number that the loop's answer bears."""

    number: int
    values: tuple[tuple[str, float], ...]


class WriteResult(NamedTuple):
    """What came of writing parameters: nothing, or why they were refused."""

    number: int
    refusal: str | None


class RosSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What the process receives first, as one line of JSON.

    Attributes:
        robot: As in the robot's file.
        namespace: Where the robot lives in the ROS graph.
        ros_arguments: What followed `--ros-args` on the command line, that flag included.
        period_ns: Of the loop, ns.
        published: The published signals, in the order of the wiring.
        topics: Topics that variables are published on, in the order of the wiring.
        set_names: Names of the values that anybody may set, in the order of the wiring.
        stand: Of these the one that stands the robot up or sits it down; None where it has no posture.
        wheel_radius: m; None where the robot's file has none.
        pitch: The place among `topics` of the pitch of the IMU; None where it has none.
        description: Of the robot, as URDF; empty where its geometry does not suffice.
        residual: What is published of the residual monitor, with its unit; empty where the robot has none.
        parameters: The model's parameters as the robot declares them, each with the value that it has now.
        reports: File descriptor of the ring from the loop.
        inboxes: That of the ring to the loop.
        is_again: Whether it takes the place of one that has died: `parameters` count, not the command line.
        is_simulated: Whether stamps are simulated time, which is published on `/clock`.
    """

    robot: str
    ros: RosSection
    namespace: str
    ros_arguments: tuple[str, ...]
    period_ns: int
    published: tuple[str, ...]
    topics: tuple[str, ...]
    set_names: tuple[str, ...]
    stand: str | None
    wheel_radius: float | None = None
    pitch: int | None = None
    description: str = ""
    residual: tuple[str, ...] = ()
    parameters: tuple[Variable, ...]
    reports: int
    inboxes: int
    is_again: bool = False
    is_simulated: bool = False

    @property
    def report_slots(self) -> int:
        """Of the ring from the loop; a cycle's report may need more than its share where its reasons are long."""
        numbers = len(self.published) + len(self.topics) + len(self.set_names) + len(self.residual)
        return _REPORTS * slots_for(_REPORT_BYTES + _NUMBER_BYTES * numbers)


encoder: Final = msgspec.msgpack.Encoder(enc_hook=float)
"""Numbers of other libraries pass as numbers."""
decode_report: Final = msgspec.msgpack.Decoder(Report).decode
decode_status: Final = msgspec.msgpack.Decoder(DiagnosticStatus).decode
decode_stamp: Final = msgspec.msgpack.Decoder(int).decode
decode_answer: Final = msgspec.msgpack.Decoder(NumberedAnswer).decode
decode_write_result: Final = msgspec.msgpack.Decoder(WriteResult).decode
decode_trajectory: Final = msgspec.msgpack.Decoder(TrajectoryPart).decode
decode_inbox: Final = msgspec.msgpack.Decoder(InboxMessage).decode
decode_write_request: Final = msgspec.msgpack.Decoder(WriteRequest).decode
decode_stranger: Final = msgspec.msgpack.Decoder(str).decode
decode_subscribed: Final = msgspec.msgpack.Decoder(bool).decode

"""What passes between the loop and the process that speaks ROS, as MessagePack in the slots of two rings."""

import enum
from typing import Final, NamedTuple

import msgspec

from segway_ecc.node.cycle.seams import Heartbeat, Report, SetValue, StampedSetpoint
from segway_ecc.node.cycle.status import Status
from segway_ecc.node.safety.modes import Action, Answer


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


@enum.unique
class ToLoop(enum.IntEnum):
    """Kinds of messages to the loop."""

    ARRIVED = 1
    WRITE = 2
    HEARD = 3
    """Whether anybody subscribes to what is told of each cycle."""


class Asked(NamedTuple):
    """A request, and the number that its answer bears."""

    action: Action
    number: int


class Arrived(NamedTuple):
    """What arrived from outside; see `segway_ecc.node.cycle.seams.Inbox`."""

    setpoints: list[StampedSetpoint]
    values: list[SetValue]
    stations: list[Heartbeat]
    requests: list[Asked]


class Answered(NamedTuple):
    """The answer to a request."""

    number: int
    answer: Answer


class ToWrite(NamedTuple):
    """A parameter that is to be written, and the number that the loop's word on it bears."""

    number: int
    name: str
    value: float


class WriteDone(NamedTuple):
    """What came of writing a parameter: nothing, or why it was refused."""

    number: int
    refusal: str | None


encoder: Final = msgspec.msgpack.Encoder(enc_hook=float)
"""Numbers of other libraries pass as numbers."""
decode_report: Final = msgspec.msgpack.Decoder(Report).decode
decode_status: Final = msgspec.msgpack.Decoder(Status).decode
decode_stamp: Final = msgspec.msgpack.Decoder(int).decode
decode_answered: Final = msgspec.msgpack.Decoder(Answered).decode
decode_write_done: Final = msgspec.msgpack.Decoder(WriteDone).decode
decode_arrived: Final = msgspec.msgpack.Decoder(Arrived).decode
decode_to_write: Final = msgspec.msgpack.Decoder(ToWrite).decode
decode_heard: Final = msgspec.msgpack.Decoder(bool).decode

"""The programs around the model node, each over channels of its own."""

from collections.abc import Sequence
from typing import NamedTuple

from segway_ecc.hil.placement.network import Channel, NowNs
from segway_ecc.hil.placement.programs import Message, NodeReport, Program
from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, NoStage, Report, Request, StampedSetpoint
from segway_ecc.node.safety.modes import Answer


class ProgramChannels(NamedTuple):
    """The way between a program and the model node.

    Attributes:
        to: Messages of the program. What only the newest of matters has its own channel.
        beats: Its heartbeats.
        back: Reports of the node.
    """

    to: Channel[Message]
    beats: Channel[Message]
    back: Channel[NodeReport]


class ProgramsStage(NoStage):
    """Hands on what the programs send; see `Stage`."""

    def __init__(self, programs: Sequence[tuple[Program, ProgramChannels]], now_ns: NowNs) -> None:
        """Connect these programs."""
        self.over: str | None = None
        self._programs = programs
        self._now_ns = now_ns

    def take_inbox(self) -> Inbox:
        """Step every program; take the messages that have arrived."""
        inbox, now_ns = Inbox(), self._now_ns()
        for program, way in self._programs:
            reports = [message.item for message in way.back.receive()]
            for message in program.step(now_ns, reports):
                (way.beats if isinstance(message, Heartbeat) else way.to).send(message)
            for arrived in (*way.to.receive(), *way.beats.receive()):
                _put(inbox, arrived.item)
        return inbox

    def publish(self, report: Report) -> None:
        """Report to every program."""
        for _, way in self._programs:
            way.back.send(NodeReport(report.stamp_ns, report.mode))


def _put(inbox: Inbox, message: Message) -> None:
    match message:
        case StampedSetpoint():
            inbox.setpoints.append(message)
        case Heartbeat():
            inbox.stations.append(message)
        case _:
            inbox.requests.append(Request(message, _nobody_waits))


def _nobody_waits(_answer: Answer) -> None:
    """The mode shows what came of a stop."""

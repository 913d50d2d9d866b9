# SPDX-License-Identifier: MIT
"""The programs around the model node, sequence control and supervision, and the stage that joins them to it.

Each is reached over channels of its own, and time is given.
"""

from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

from segway_ecc.deploy.station.fleet import Heartbeats
from segway_ecc.deploy.station.requests import AGAIN_NS
from segway_ecc.hil.placement.network import Channel
from segway_ecc.hil.rig.simulated_bus import NowNs
from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, NoStage, Report, Request, StampedSetpoint
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.sequence.manoeuvre import LEAD_NS, Manoeuvre, schedule

STATION: Final = "station"


class NodeReport(NamedTuple):
    """What the model node publishes of a cycle: its stamp, ns since the Unix epoch, and its mode."""

    stamp_ns: int
    mode: Mode


Message = StampedSetpoint | Heartbeat | Action


class Program(Protocol):
    """A program that exchanges messages with the model node, over a network or not."""

    def step(self, now_ns: int, reports: Sequence[NodeReport]) -> Sequence[Message]:
        """What it sends now, simulated ns, after the reports received since the last step."""


class UnstampedSequence:
    """Sequence control that sends each set-point when its time has come by its own clock, as on `cmd_vel`."""

    def __init__(self, manoeuvre: Manoeuvre, start_ns: int) -> None:
        """Play from a simulated time on."""
        self._schedule = [(start_ns + due.offset_ns, due.setpoint) for due in schedule(manoeuvre)]
        self._next = 0

    def step(self, now_ns: int, reports: Sequence[NodeReport]) -> Sequence[Message]:
        """See `Program.step`."""
        del reports
        first = self._next
        while self._next < len(self._schedule) and self._schedule[self._next][0] <= now_ns:
            self._next += 1
        return [StampedSetpoint(setpoint, None) for _, setpoint in self._schedule[first : self._next]]


class StampedSequence:
    """Sequence control that sends each set-point ahead, with the robot's own time for it, as on `cmd_vel_stamped`."""

    def __init__(self, manoeuvre: Manoeuvre, start_stamp_ns: int) -> None:
        """Play from a time of the robot's on."""
        self._schedule = deque((start_stamp_ns + due.offset_ns, due.setpoint) for due in schedule(manoeuvre))

    def step(self, now_ns: int, reports: Sequence[NodeReport]) -> Sequence[Message]:
        """See `Program.step`."""
        del now_ns
        due: list[Message] = []
        until_ns = reports[-1].stamp_ns + LEAD_NS if reports else 0
        while self._schedule and self._schedule[0][0] <= until_ns:
            stamp_ns, setpoint = self._schedule.popleft()
            due.append(StampedSetpoint(setpoint, stamp_ns))
        return due


class Supervisor:
    """Beats, and from a time on asks for a stop until the node reports that it has stopped."""

    def __init__(self, stop_ns: int | None) -> None:
        """Press stop at a simulated time; None for never."""
        self._heartbeats = Heartbeats(STATION)
        self._again_ns = stop_ns

    def step(self, now_ns: int, reports: Sequence[NodeReport]) -> Sequence[Message]:
        """See `Program.step`."""
        beat_ns = self._heartbeats.due(now_ns)
        messages: list[Message] = [] if beat_ns is None else [Heartbeat(STATION, beat_ns)]
        if self._again_ns is None or now_ns < self._again_ns:
            return messages
        if any(report.mode is Mode.FAULT for report in reports):
            self._again_ns = None
            return messages
        self._again_ns += AGAIN_NS
        return [*messages, Action.STOP]


class ProgramChannels(NamedTuple):
    """The way between a program and the model node.

    Attributes:
        to: Messages of the program. What only the newest of matters has its own channel.
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
                match arrived.item:
                    case StampedSetpoint() as setpoint:
                        inbox.setpoints.append(setpoint)
                    case Heartbeat() as beat:
                        inbox.stations.append(beat)
                    case action:  # whose answer nobody waits for: the mode shows it
                        inbox.requests.append(Request(action, lambda _answer: None))
        return inbox

    def publish(self, report: Report) -> None:
        """Report to every program."""
        for _, way in self._programs:
            way.back.send(NodeReport(report.stamp_ns, report.mode))

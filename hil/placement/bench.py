# SPDX-License-Identifier: MIT
"""One run in lock step: plant, drives, guard and gateway on the robot's bus, and the three parts where they belong.

Sequence control and supervision are programs around the model node: each is reached over channels of its own, joined
to the node by a stage, and time is given.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import msgspec

from segway_ecc.deploy.station.fleet import Heartbeats
from segway_ecc.deploy.station.requests import AGAIN_NS
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.hil.campaign.watch import DriveWatch, NodeWatch
from segway_ecc.hil.design.balance import Truth
from segway_ecc.hil.design.balance_margins import LIES_AT
from segway_ecc.hil.faults.fault import Injections
from segway_ecc.hil.placement.judging import FALLEN_RAD, PostureRecorder, RunRecord
from segway_ecc.hil.placement.network import PERFECT, Channel, Delivery, Network, RemoteLink
from segway_ecc.hil.placement.results import Placement
from segway_ecc.hil.processes import quiet
from segway_ecc.hil.rig.lockstep_guard import LockstepGuard
from segway_ecc.hil.rig.simulated_bus import NowNs
from segway_ecc.hil.rig.simulation import WALL_START_NS, LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, NoStage, Report, Request, StampedSetpoint
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.sequence.manoeuvre import LEAD_NS, Manoeuvre, schedule

START_S: Final = 3.0
"""When the manoeuvre begins, s of simulated time: by then it has stood up, if it ever does."""
STATION: Final = "station"
_NS_PER_S: Final = 1_000_000_000


class NodeReport(NamedTuple):
    """What the model node publishes of a cycle: its stamp, ns since the Unix epoch, and its mode."""

    stamp_ns: int
    mode: Mode


class Introduction(NamedTuple):
    """A base station that is to watch over the robot from now on; its heartbeats count when this has arrived."""

    station: str


Message = StampedSetpoint | Heartbeat | Introduction | Action


Program = Callable[[int, Sequence[NodeReport]], Sequence[Message]]
"""Exchanges messages with the model node, over a network or not.

It gives what it sends at a time, simulated ns, after the reports received since it was last called.
"""


def sequence_program(manoeuvre: Manoeuvre, start_ns: int, *, stamped: bool) -> Program:
    """Sequence control that sends each set-point ahead, with the robot's own time for it, as on `cmd_vel_stamped`.

    Or, where not `stamped`, when its time has come by its own clock, as on `cmd_vel`. It plays from `start_ns` on: the
    robot's time where `stamped`, else simulated time.
    """
    pending = deque((start_ns + due.offset_ns, due.setpoint) for due in schedule(manoeuvre))

    def step(now_ns: int, reports: Sequence[NodeReport]) -> Sequence[Message]:
        if stamped:
            now_ns = reports[-1].stamp_ns + LEAD_NS if reports else 0
        sent: list[Message] = []
        while pending and pending[0][0] <= now_ns:
            at_ns, setpoint = pending.popleft()
            sent.append(StampedSetpoint(setpoint, at_ns if stamped else None))
        return sent

    return step


class Supervisor:
    """Introduces itself, beats, and from a time on asks for a stop until the node reports that it has stopped."""

    def __init__(self, stop_ns: int | None) -> None:
        """Press stop at a simulated time; None for never."""
        self._heartbeats = Heartbeats(STATION)
        self._again_ns = stop_ns
        self._is_introduced = False

    def __call__(self, now_ns: int, reports: Sequence[NodeReport]) -> Sequence[Message]:
        """See `Program`."""
        beat_ns = self._heartbeats.due(now_ns)
        messages: list[Message] = [] if beat_ns is None else [Heartbeat(STATION, beat_ns)]
        if not self._is_introduced:
            self._is_introduced = True
            messages.append(Introduction(STATION))
        if self._again_ns is None or now_ns < self._again_ns:
            return messages
        if any(report.mode is Mode.FAULT for report in reports):
            self._again_ns = None
            return messages
        self._again_ns += AGAIN_NS
        return [*messages, Action.STOP]


class ProgramChannels(NamedTuple):
    """The way `to` the model node from a program, and `back` with its reports.

    What only the newest of matters, of the program's messages, has its own channel.
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
            for message in program(now_ns, reports):
                (way.beats if isinstance(message, Heartbeat) else way.to).send(message)
            for arrived in (*way.to.receive(), *way.beats.receive()):
                match arrived.item:
                    case StampedSetpoint() as setpoint:
                        inbox.setpoints.append(setpoint)
                    case Heartbeat() as beat:
                        inbox.stations.append(beat)
                    case Introduction(station):
                        inbox.introductions.append(station)
                    case action:  # whose answer nobody waits for: the mode shows it
                        inbox.requests.append(Request(action, lambda _answer: None))
        return inbox

    def publish(self, report: Report) -> None:
        """Report to every program."""
        for _, way in self._programs:
            way.back.send(NodeReport(report.stamp_ns, report.mode))


class PlacementRun(msgspec.Struct, frozen=True, kw_only=True):
    """One run.

    Attributes:
        robot: The robot file, or the name of one that ships with the package.
        manoeuvre: What sequence control plays from `START_S` on.
        until_s: How long the run lasts, s of simulated time.
        stamped: Whether set-points are sent ahead, with their time.
        stop_at_s: When stop is pressed, s of simulated time; None for never.
        pushed_n: What pushes the body for a tenth of a second at `START_S` + 1 s, N.
        delivery: What becomes of the balance's messages that are lost or overtaken.
    """

    robot: str
    placement: Placement
    manoeuvre: Manoeuvre
    until_s: float
    network: Network = PERFECT
    stamped: bool = True
    stop_at_s: float | None = None
    pushed_n: float = 0.0
    delivery: Delivery = Delivery.NEWEST
    seed: int = 1
    until_fallen: bool = False


@quiet("segway_ecc.node", "segway_ecc.firmware_io")
def run(job: PlacementRun) -> RunRecord:
    """Run a job, without the messages of node and hardware.

    Raises:
        ConfigurationError: The robot has no hardware, or no posture.
    """
    return _LockstepPlacement(job).run()


class _LockstepPlacement:
    """Everything of one run, joined."""

    def __init__(self, job: PlacementRun) -> None:
        self._job = job
        file = load_robot(job.robot)
        if not isinstance(hardware_of(file), BusSettings):
            raise ConfigurationError(f"robot '{job.robot}' is on no CAN bus, which is what is put elsewhere here")
        self._rig = rig = LockstepRig.of(hardware_of(file))
        self._injections = Injections((), 0, rig.now_ns)
        self._end = rig.bus.attach("plant")
        self._simulated = simulated_robot(file, self._end)
        plant = self._simulated.plant
        plant.write("InitialPitch", LIES_AT)
        plant.write("Seed", float(job.seed))
        self._simulated.outputs = plant.initialize(self._simulated.inputs)
        self._drive = DriveWatch(self._simulated, self._injections)
        self._truth: list[Truth] = []
        names = self._simulated.output_names
        self._places = [names.index(f"truth.{name}") for name in Truth._fields[1:]]
        self._guard = LockstepGuard(hardware_of(file), rig)
        rig.add(self._guard)
        self._robot = build_robot(file, rig, self._link())
        self._world = self._make_world()
        rig.attach(self._simulated, self._observe)

    def run(self) -> RunRecord:
        """Run it."""
        robot = self._robot
        if robot.file.safety is None or robot.file.safety.posture is None:
            raise ConfigurationError(f"robot '{self._job.robot}' has no safety.posture: it is no segway")
        postures = PostureRecorder(robot.period_ns)
        watch = NodeWatch(self._injections, robot.hardware, postures)
        loop = robot.loop(self._world, watch)
        watch.modes = loop.modes
        self._end.open()
        loop.run(round(self._job.until_s * _NS_PER_S / robot.period_ns))
        self._end.close()
        armed_ns = self._injections.timeline.started_ns or 0
        drive, guard = self._drive, self._guard.watch.interventions
        tick_ns = self._simulated.tick_ns  # a drive gives what it gave at its last tick until the next one
        return RunRecord(
            truth=self._truth,
            changes=[change._replace(at_ns=change.at_ns + armed_ns) for change in watch.changes],
            postures=postures.postures,
            zero_s=None if drive.is_pushing else (armed_ns + drive.last_push_ns + tick_ns) / _NS_PER_S,
            guard_s=guard[0].first_ns / _NS_PER_S if guard else None,
            digest=drive.digest,
        )

    def _link(self) -> Link:
        job, rig = self._job, self._rig
        if not job.placement.balance_crosses:
            return rig.bus.attach("node")
        up = self._channel("up", job.delivery, crosses=True)
        down = self._channel("down", job.delivery, crosses=True)
        link = RemoteLink(rig.bus.attach("node"), up, down, rig.now_ns)
        rig.add(link)
        return link

    def _make_world(self) -> ProgramsStage:
        job, start_ns = self._job, round(START_S * _NS_PER_S)
        since_ns = WALL_START_NS + start_ns if job.stamped else start_ns
        sequence = sequence_program(job.manoeuvre, since_ns, stamped=job.stamped)
        supervisor = Supervisor(None if job.stop_at_s is None else round(job.stop_at_s * _NS_PER_S))
        ways: list[tuple[Program, ProgramChannels]] = [
            (sequence, self._way("sequence", crosses=job.placement.sequence_crosses)),
            (supervisor, self._way("supervision", crosses=job.placement.supervision_crosses)),
        ]
        return ProgramsStage(ways, self._rig.now_ns)

    def _way(self, name: str, *, crosses: bool) -> ProgramChannels:
        """The qualities of service are those of the model node's topics and services."""
        return ProgramChannels(
            self._channel(f"{name}, to", Delivery.IN_ORDER, crosses=crosses),
            self._channel(f"{name}, beats", Delivery.NEWEST, crosses=crosses),
            self._channel(f"{name}, back", Delivery.IN_ORDER, crosses=crosses),
        )

    def _channel(self, name: str, delivery: Delivery, *, crosses: bool) -> Channel[Any]:
        network = self._job.network if crosses else PERFECT
        return Channel(network, delivery, f"{self._job.seed}/{name}", self._rig.now_ns)

    def _observe(self, _wall_ns: int, outputs: Sequence[float]) -> None:
        now_s = self._rig.now_ns() / _NS_PER_S
        self._drive.look(outputs)
        self._truth.append(Truth(now_s, *(outputs[place] for place in self._places)))
        if self._job.pushed_n:
            is_pushed = START_S + 1.0 <= now_s < START_S + 1.1
            self._simulated.plant.write("PushForce", self._job.pushed_n if is_pushed else 0.0)
        if self._job.until_fallen and now_s > START_S and abs(self._truth[-1].pitch) > FALLEN_RAD:
            self._world.over = "the robot lies"

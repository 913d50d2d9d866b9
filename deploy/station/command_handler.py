"""What operators ask for, carried out: the station without its threads and without ROS. Pure: time is given."""

import logging
from collections import Counter
from collections.abc import Callable
from typing import Final

import msgspec

from segway_ecc.deploy.station.connection import Reply, RobotConnection
from segway_ecc.deploy.station.control import Control
from segway_ecc.deploy.station.deadman import DeadMan, fitted
from segway_ecc.deploy.station.events import EventLog
from segway_ecc.deploy.station.fleet import Fleet, Robot
from segway_ecc.deploy.station.heartbeats import Heartbeats
from segway_ecc.deploy.station.posture import PostureRequest
from segway_ecc.deploy.station.requests import Requests
from segway_ecc.deploy.station.robot_messages import ModeReport, RobotMessage, SetpointReport
from segway_ecc.deploy.station.robot_tasks import RobotTasks, SubmittedCommand
from segway_ecc.deploy.station.sequences import SequencePlayback
from segway_ecc.deploy.station.stops import Stop, StopState
from segway_ecc.deploy.station.views import Act, Drive, FleetView, RobotView
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.safety.modes import Action
from segway_ecc.node.sequence.manoeuvre import Manoeuvre
from segway_ecc.node.sequence.player import Odometry

_ASKED_OF_SERVICES: Final = {
    Act.ARM: Action.ARM,
    Act.DISARM: Action.DISARM,
    Act.CLEAR_FAULT: Action.CLEAR_FAULT,
}
_OURS: Final = frozenset({Act.TAKE_CONTROL, Act.RELEASE_CONTROL, Act.BREAK_OFF, Act.CLEAR_FAULT})
"""What is done here, at least in part, even where the robot is lost or its stop is not confirmed."""
_logger = logging.getLogger(__name__)


class CommandHandler:
    """Carries out commands and driving on robots that are heard.

    Attributes:
        fleet: The robots.
        control: Who has control of which.
        refused: Commands and set-points that were refused or cut, by cause.
    """

    def __init__(self, events: EventLog, beats: Heartbeats, limits: Setpoint) -> None:
        """Begin with no robot; set-points are cut to `limits` (m/s, rad/s)."""
        self.fleet = Fleet(events)
        self.control = Control(events)
        self.refused: Counter[str] = Counter()
        self._events = events
        self._beats = beats
        self._limits = limits
        self._dead_man = DeadMan()
        self._seats: dict[str, RobotTasks] = {}

    def add(self, name: str, line: RobotConnection) -> None:
        """A robot can be spoken to over `line` from now on."""
        self._seats[name] = RobotTasks(line, Requests(line), Stop(line, self._teller(name)), PostureRequest(line))

    def is_waiting_for(self, name: str) -> bool:
        """Whether a robot's word is waited for."""
        seat = self._seats.get(name)
        return seat is not None and (seat.requests.is_pending or seat.stop.is_pending or seat.stand.is_pending)

    def hear(self, name: str, heard: RobotMessage, at_ns: int) -> None:
        """Take what a robot said at `at_ns`, monotonic."""
        self.fleet.hear(name, heard, at_ns)
        seat = self._seats[name]
        if isinstance(heard, ModeReport):
            seat.stop.hear(heard, at_ns)
            seat.stand.hear(heard)
            self._beats.hear(name, heard, at_ns)
        elif isinstance(heard, SetpointReport) and seat.playing is not None:
            seat.playing.hear(heard, at_ns)

    def hear_answers(self, name: str) -> None:
        """Take what a robot's services answered."""
        seat = self._seats[name]
        for answered in seat.line.answers():
            if answered.action is Action.STOP:
                seat.stop.take(answered)
            else:
                seat.requests.take(answered)

    def step(self, now_ns: int) -> None:
        """Everything that is due: requests again, zeros, set-points of sequences."""
        self.fleet.look(now_ns)
        for name, seat in self._seats.items():
            seat.stop.step(now_ns)
            seat.requests.step(now_ns)
            seat.stand.step(now_ns)
            if seat.is_playing:
                self._play_on(name, seat, now_ns)
        for name, ran_out in self._dead_man.zeros_due(now_ns):
            self._seats[name].line.drive(REST)
            if ran_out:
                self._events.add(name, f"{self.control.of(name)} no longer drives: told to rest", level="warning")

    def view(self, now_ns: int) -> FleetView:
        """The picture of all robots."""
        robots = [self._view(self.fleet.robots[name], now_ns) for name in sorted(self.fleet.robots)]
        return FleetView(time_s=now_ns * 1e-9, robots=robots)

    def stop(self, asked: SubmittedCommand, now_ns: int) -> None:
        """Stop a robot, whoever asks, before anything else is done."""
        name, reply = asked.command.robot, self._logged(asked)
        seat = self._seats.get(name)
        if seat is None:
            self._refuse("unknown robot", reply, f"no robot is known as {name}")
            return
        seat.stop.ask(reply, asked.at_ns, now_ns)
        self._dead_man.release(name, now_ns)
        if seat.break_off(f"{asked.who} pressed stop"):
            self._tell_outcome(name, seat)

    def command(self, asked: SubmittedCommand, now_ns: int) -> None:
        """Carry out a command other than a stop."""
        name, act, reply = asked.command.robot, asked.command.act, self._logged(asked)
        robot, seat = self.fleet.robots.get(name), self._seats.get(name)
        if robot is None or seat is None:
            self._refuse("unknown robot", reply, f"no robot is known as {name}")
            return
        refusal = self._refusal(asked, robot, seat, now_ns)
        if refusal is not None:
            self._refuse(refusal[0], reply, refusal[1])
        elif act in _ASKED_OF_SERVICES:
            if act is Act.CLEAR_FAULT:
                seat.stop.drop("the fault was cleared before the stop was confirmed")
            seat.requests.ask(_ASKED_OF_SERVICES[act], reply, now_ns)
        else:
            self._do(asked, robot, seat, reply, now_ns)

    def drive(self, who: str, drive: Drive, at_ns: int, now_ns: int) -> None:
        """Send a set-point now, from who has control.

        Args:
            who: Who drives.
            drive: The set-point.
            at_ns: When it was given, monotonic; it counts as renewed then.
            now_ns: The present.
        """
        name, wanted = drive.robot, fitted(drive.linear, drive.angular, self._limits)
        refusal = self._drive_refusal(who, name, wanted)
        if wanted is None or refusal is not None:
            self.refused[f"drive: {refusal}"] += 1
            return
        if wanted == REST:
            self._dead_man.release(name, now_ns)
            return
        if wanted != (drive.linear, drive.angular):
            self.refused["drive: cut to the limits"] += 1
        if not self.control.may_drive(name, who):
            self.refused["drive: another has control"] += 1
            return
        seat = self._seats[name]
        if seat.break_off(f"{who} drives by hand"):
            self._tell_outcome(name, seat)
        self._dead_man.renew(name, wanted, at_ns)
        seat.line.drive(wanted)

    def left(self, who: str, now_ns: int) -> None:
        """An operator is gone: what they moved is told to rest, and nobody has control of it."""
        for name in self.control.robots_of(who):
            self._let_go(name, f"{who} is gone", now_ns)
            self.control.release(name, who)

    def close(self, now_ns: int) -> None:
        """The station ends: everything that moves by it is told to rest, every command is answered."""
        for name, seat in self._seats.items():
            if self._dead_man.drives(name):
                seat.line.drive(REST)
            self._let_go(name, "the station ends", now_ns)
            seat.requests.fail("the station ends")
            seat.stand.fail("the station ends")
            seat.stop.drop("the station ends")

    def _refusal(self, asked: SubmittedCommand, robot: Robot, seat: RobotTasks, now_ns: int) -> tuple[str, str] | None:
        """The cause and the text of why a command is not even tried."""
        act = asked.command.act
        needs_robot = act not in _OURS or act is Act.CLEAR_FAULT
        if needs_robot and not robot.is_alive:
            return "lost", f"the robot is lost: it has said nothing for {robot.age_s(now_ns):.1f} s"
        if act not in _OURS and act is not Act.DISARM and seat.stop.state is StopState.ASKED:
            return "stopped", "a stop is under way; clear the fault first"
        if act is Act.PLAY:
            if isinstance(asked.manoeuvre, str):
                return "sequence", asked.manoeuvre
            if not robot.is_active:
                return "not armed", f"the robot is {robot.mode.mode} ({robot.mode.reason}): arm it first"
        if act in {Act.STAND, Act.SIT} and not robot.mode.can_stand:
            return "cannot stand", "this robot cannot be told to stand up or to sit down"
        refusal = self.control.refusal(robot.robot, asked.who, act)
        return None if refusal is None else ("control", refusal)

    def _drive_refusal(self, who: str, name: str, wanted: Setpoint | None) -> str | None:
        robot, seat = self.fleet.robots.get(name), self._seats.get(name)
        if robot is None or seat is None:
            return "unknown robot"
        if wanted is None:
            return "not finite"
        if wanted == REST:
            return None if self.control.of(name) == who else "another has control"
        if seat.stop.state is not StopState.NONE:
            return "stopped"
        return None if robot.is_active else "not armed"

    def _do(self, asked: SubmittedCommand, robot: Robot, seat: RobotTasks, reply: Reply, now_ns: int) -> None:
        """What no service of the robot answers, or what is the station's own."""
        name, who = robot.robot, asked.who
        match asked.command.act:
            case Act.TAKE_CONTROL:
                if self.control.of(name) not in {"", who}:
                    self._let_go(name, f"{who} took control", now_ns)
                before = self.control.take(name, who)
                reply(True, f"taken from {before}" if before not in {"", who} else "you have control")  # noqa: FBT003
            case Act.RELEASE_CONTROL:
                had = self.control.of(name) == who
                if had:
                    self._let_go(name, f"{who} gave up control", now_ns)
                    self.control.release(name, who)
                reply(had, "nobody has control now" if had else "you did not have control")
            case Act.STAND | Act.SIT as act:
                seat.stand.ask(reply, now_ns, up=act is Act.STAND)
            case Act.BREAK_OFF:
                is_over = seat.break_off(f"{who} broke it off")
                if is_over:
                    self._tell_outcome(name, seat)
                reply(is_over, "broken off" if is_over else "nothing is being played")
            case Act.PLAY:
                self._play(asked, seat, reply, now_ns)

    def _play(self, asked: SubmittedCommand, seat: RobotTasks, reply: Reply, now_ns: int) -> None:
        name = asked.command.robot
        if seat.break_off("another sequence was started"):
            self._tell_outcome(name, seat)
        self._dead_man.release(name, now_ns)
        if isinstance(asked.manoeuvre, Manoeuvre):
            seat.playing = SequencePlayback(asked.manoeuvre, asked.command.name, reply, now_ns)

    def _play_on(self, name: str, seat: RobotTasks, now_ns: int) -> None:
        robot, playing = self.fleet.robots[name], seat.playing
        if playing is None:
            return
        if not robot.is_alive:
            seat.break_off("the robot is lost")
        elif not robot.is_active:
            seat.break_off(f"the robot went to {robot.mode.mode}: {robot.mode.reason}")
        else:
            playing.step(seat.line, robot.newest(Odometry, now_ns), now_ns)
        if playing.is_over:
            self._tell_outcome(name, seat)

    def _let_go(self, name: str, reason: str, now_ns: int) -> None:
        """Whatever moves a robot by us ends, and it is told to rest."""
        self._dead_man.release(name, now_ns)
        seat = self._seats[name]
        if seat.break_off(reason):
            self._tell_outcome(name, seat)

    def _tell_outcome(self, name: str, seat: RobotTasks) -> None:
        if seat.playing is not None:
            level = "info" if seat.playing.view.state == "done" else "warning"
            self._events.add(name, seat.playing.outcome, level=level)

    def _view(self, robot: Robot, now_ns: int) -> RobotView:
        seat = self._seats[robot.robot]
        return msgspec.structs.replace(
            robot.view(now_ns, self._beats),
            stop=seat.stop.state.value,
            stop_after_s=seat.stop.after_s,
            controller=self.control.of(robot.robot),
            sequence=seat.playing.view if seat.playing is not None else None,
        )

    def _refuse(self, cause: str, reply: Reply, text: str) -> None:
        self.refused[f"command: {cause}"] += 1
        reply(False, text)  # noqa: FBT003 - the contract's form

    def _logged(self, asked: SubmittedCommand) -> Reply:
        """Tells the operator and the event log what came of a command."""
        act = asked.command.act

        def reply(accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
            level = ("warning" if accepted else "error") if act is Act.STOP else ("info" if accepted else "warning")
            what = f"{act}: {'' if accepted else 'failed: '}{text}"
            self._events.add(asked.command.robot[:100], what, level=level, who=asked.who)
            asked.reply(accepted, text)

        return reply

    def _teller(self, name: str) -> Callable[[str, str], None]:
        return lambda text, level: self._events.add(name, text, level=level)

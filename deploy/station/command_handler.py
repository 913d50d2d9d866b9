# SPDX-License-Identifier: MIT
"""Carries out operators' commands: the station without its threads and without ROS. Pure: time is given."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import msgspec

from segway_ecc.deploy.station.control import Control, DeadMan, fitted
from segway_ecc.deploy.station.fleet import EventLog, Fleet, Heartbeats, Robot
from segway_ecc.deploy.station.kept_stops import MOST, is_namespace
from segway_ecc.deploy.station.requests import Reply, Requests, RobotConnection, Stop, StopState
from segway_ecc.deploy.station.robot_messages import ModeReport, RobotMessage
from segway_ecc.deploy.station.sequences import SequencePlayback
from segway_ecc.deploy.station.views import Act, Command, Drive, FleetView, RobotView
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.trajectory import TrajectoryStatus
from segway_ecc.node.safety.modes import Action
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry

_SERVICES: Final = {
    Act.ARM: Action.ARM,
    Act.DISARM: Action.DISARM,
    Act.CLEAR_FAULT: Action.CLEAR_FAULT,
    Act.STAND: Action.STAND_UP,
    Act.SIT: Action.SIT_DOWN,
}
_OURS: Final = frozenset({Act.TAKE_CONTROL, Act.RELEASE_CONTROL, Act.BREAK_OFF, Act.CLEAR_FAULT, Act.DISMISS})
"""What the station carries out, at least in part, even where the robot is lost or its stop is not confirmed."""


@dataclass(frozen=True, slots=True)
class SubmittedCommand:
    """A command as it was submitted, at `at_ns`, monotonic; a manoeuvre to be played is decoded, or an error's text."""

    who: str
    command: Command
    reply: Reply
    at_ns: int
    manoeuvre: Manoeuvre | str = ""


class RobotTasks:
    """What is in progress with one robot; `playback` is the sequence that is played, or was last."""

    def __init__(self, connection: RobotConnection, stop: Stop, log: Callable[[str, str], None]) -> None:
        """Begin with nothing but the robot's stop; `log` takes text and level of events."""
        self.connection = connection
        self.requests = Requests(connection)
        self.stop = stop
        self.playback: SequencePlayback | None = None
        self._log = log

    @property
    def is_pending(self) -> bool:
        """Whether a report or a response of the robot is awaited."""
        return self.requests.is_pending or self.stop.is_pending

    def step(self, now_ns: int) -> None:
        """Send again what is not confirmed yet."""
        self.requests.step(now_ns)

    def break_off(self, reason: str, now_ns: int) -> bool:
        """End the sequence that is played; False where none is."""
        if self.playback is None or self.playback.is_over:
            return False
        self.playback.break_off(self.connection, reason, now_ns)
        self.log_outcome(self.playback)
        return True

    def log_outcome(self, playback: SequencePlayback) -> None:
        """Log how a sequence ended."""
        self._log(playback.outcome, "info" if playback.view.state == "done" else "warning")

    def fail(self, text: str) -> None:
        """Reply to everything that is pending that it failed."""
        self.requests.fail(text)


class CommandHandler:
    """Carries out commands and driving on the robots that were received; `refused` counts what was not, or clamped."""

    def __init__(self, events: EventLog, beats: Heartbeats, limits: Setpoint) -> None:
        """Begin with no robot; set-points are clamped to `limits` (m/s, rad/s)."""
        self.fleet = Fleet(events)
        self.control = Control(events)
        self.refused: Counter[str] = Counter()
        self._events = events
        self._beats = beats
        self._limits = limits
        self._dead_man = DeadMan()
        self._tasks: dict[str, RobotTasks] = {}
        self._stops: dict[str, Stop] = {}

    def add(self, name: str, connection: RobotConnection) -> None:
        """Use `connection` for the robot of a namespace from now on."""
        stop = self._stop_of(name)
        stop.connect(connection)
        self._tasks[name] = RobotTasks(connection, stop, self._log_of(name))

    def pending_stops(self) -> Mapping[str, str]:
        """The robots with a stop that is not confirmed, and who requested it."""
        return {name: stop.who for name, stop in self._stops.items() if stop.state is StopState.REQUESTED}

    def is_waiting_for(self, name: str) -> bool:
        """Whether a report or a response of a robot is awaited."""
        return name in self._tasks and self._tasks[name].is_pending

    def on_message(self, name: str, message: RobotMessage, at_ns: int) -> None:
        """Process what a robot published, received at `at_ns`, monotonic."""
        self.fleet.update(name, message, at_ns)
        tasks = self._tasks[name]
        if isinstance(message, ModeReport):
            robot = self.fleet.robots.get(name)
            tasks.stop.on_mode(message, at_ns, is_disputed=robot is not None and robot.is_disputed(at_ns))
            self._beats.on_mode(name, message, at_ns)
        elif isinstance(message, TrajectoryStatus) and tasks.playback is not None:
            was_over = tasks.playback.is_over
            tasks.playback.on_status(message)
            if tasks.playback.is_over and not was_over:
                tasks.log_outcome(tasks.playback)

    def receive_responses(self, name: str) -> None:
        """Process the responses of a robot's services."""
        tasks = self._tasks[name]
        for response in tasks.connection.responses():
            (tasks.stop if response.action is Action.STOP else tasks.requests).on_response(response)

    def step(self, now_ns: int) -> None:
        """Everything that is due: requests again, zeros, set-points of sequences."""
        self.fleet.mark_lost(now_ns)
        for stop in self._stops.values():
            stop.step(now_ns)
        for name, tasks in self._tasks.items():
            if self.control.of(name) and self._beats.is_introduction_due(name, now_ns):
                tasks.connection.introduce(self._beats.name)
            tasks.step(now_ns)
            robot = self.fleet.robots.get(name)  # none where it was dismissed: it goes on once it is found again
            if tasks.playback is not None and robot is not None:
                self._continue_sequence(robot, tasks, tasks.playback, now_ns)
        for name, ran_out in self._dead_man.zeros_due(now_ns):
            self._tasks[name].connection.drive(REST)
            if ran_out:
                self._events.add(name, f"{self.control.of(name)} no longer drives: brought to rest", level="warning")

    def view(self, now_ns: int) -> FleetView:
        """The picture of all robots that were found, or that are to be stopped."""
        names = sorted({*self.fleet.robots, *self.pending_stops()})
        return FleetView(time_s=now_ns * 1e-9, robots=[self._view(name, now_ns) for name in names])

    def stop(self, submitted: SubmittedCommand, now_ns: int) -> None:
        """Stop a robot, whoever requests it, before anything else is done."""
        name, reply = submitted.command.robot, self._logged(submitted)
        is_known = name in self._tasks
        if not is_known and not is_namespace(name):
            self._refuse("unknown robot", reply, f"no robot can be known as {name}: a namespace begins with /")
        elif not is_known and name not in self._stops and len(self._stops) - len(self._tasks) >= MOST:
            self._refuse("too many stops", reply, f"{MOST} robots that were not found are to be stopped already")
        else:
            self._stop_of(name).send(submitted.who, reply, submitted.at_ns, now_ns)
            if is_known:
                self._bring_to_rest(name, f"{submitted.who} pressed stop", now_ns)

    def command(self, submitted: SubmittedCommand, now_ns: int) -> None:
        """Carry out a command other than a stop."""
        name, act, reply = submitted.command.robot, submitted.command.act, self._logged(submitted)
        robot, tasks = self.fleet.robots.get(name), self._tasks.get(name)
        if act is Act.CANCEL_STOP and name in self._stops:
            self._cancel_stop(submitted.who, name, reply)
            return
        if robot is None or tasks is None:
            self._refuse("unknown robot", reply, f"no robot is known as {name}")
            return
        refusal = self._refusal(submitted, robot, tasks, now_ns)
        if refusal is not None:
            self._refuse(refusal[0], reply, refusal[1])
        elif act in _SERVICES:
            if act is Act.CLEAR_FAULT:
                tasks.stop.cancel("the fault was cleared before the stop was confirmed")
            tasks.requests.send(_SERVICES[act], reply, now_ns)
        else:
            self._carry_out(submitted, tasks, reply, now_ns)

    def drive(self, who: str, drive: Drive, at_ns: int, now_ns: int) -> None:
        """Send a set-point now, from who has control; it was given, and counts as renewed, at `at_ns`, monotonic."""
        name, wanted = drive.robot, fitted(drive.linear, drive.angular, self._limits)
        refusal = self._drive_refusal(who, name, wanted)
        if wanted is None or refusal is not None:
            self.refused[f"drive: {refusal}"] += 1
            return
        if wanted == REST:
            self._dead_man.release(name, now_ns)
            return
        if wanted != (drive.linear, drive.angular):
            self.refused["drive: clamped to the limits"] += 1
        if not self.control.may_drive(name, who):
            self.refused["drive: another has control"] += 1
            return
        tasks = self._tasks[name]
        tasks.break_off(f"{who} drives by hand", now_ns)
        self._dead_man.renew(name, at_ns)
        tasks.connection.drive(wanted)

    def leave(self, who: str, now_ns: int) -> None:
        """An operator is gone: bring to rest what they moved, and release their control."""
        for name in self.control.robots_of(who):
            self._bring_to_rest(name, f"{who} is gone", now_ns)
            self.control.release(name, who)

    def close(self, now_ns: int) -> None:
        """End the station: bring to rest everything that moves by it, and answer every command."""
        for name, tasks in self._tasks.items():
            if self._dead_man.drives(name):
                tasks.connection.drive(REST)
            self._bring_to_rest(name, "the station ends", now_ns)
            tasks.fail("the station ends")
        for stop in self._stops.values():
            stop.cancel("the station ends")

    def _refusal(
        self, submitted: SubmittedCommand, robot: Robot, tasks: RobotTasks, now_ns: int
    ) -> tuple[str, str] | None:
        """The cause and the text of why a command is not even tried."""
        act = submitted.command.act
        needs_robot = act not in _OURS or act is Act.CLEAR_FAULT
        if needs_robot and not robot.is_alive:
            return "lost", f"the robot is lost: nothing received for {robot.age_s(now_ns):.1f} s"
        if act not in _OURS and act is not Act.DISARM and tasks.stop.state is StopState.REQUESTED:
            return "stopped", "a stop is pending; clear the fault first"
        if act is Act.PLAY:
            if isinstance(submitted.manoeuvre, str):
                return "sequence", submitted.manoeuvre
            if not robot.is_active:
                return "not armed", f"the robot is {robot.mode.mode} ({robot.mode.reason}): arm it first"
        if act in {Act.STAND, Act.SIT} and not robot.mode.can_stand:
            return "cannot stand", "this robot cannot stand up or sit down by command"
        refusal = self.control.refusal(robot.robot, submitted.who, act)
        why = None if refusal is None else ("control", refusal)
        return _dismissal_refusal(robot, tasks) if why is None and act is Act.DISMISS else why

    def _drive_refusal(self, who: str, name: str, wanted: Setpoint | None) -> str | None:
        robot, tasks = self.fleet.robots.get(name), self._tasks.get(name)
        if robot is None or tasks is None:
            return "unknown robot"
        if wanted is None:
            return "not finite"
        if wanted == REST:
            return None if self.control.of(name) == who else "another has control"
        if tasks.stop.state is not StopState.NONE:
            return "stopped"
        return None if robot.is_active else "not armed"

    def _carry_out(self, submitted: SubmittedCommand, tasks: RobotTasks, reply: Reply, now_ns: int) -> None:
        """Carry out what no service of the robot answers, or what is the station's own."""
        name, who = submitted.command.robot, submitted.who
        match submitted.command.act:
            case Act.TAKE_CONTROL:
                if self.control.of(name) not in {"", who}:
                    self._bring_to_rest(name, f"{who} took control", now_ns)
                before = self.control.give(name, who)
                reply(True, f"taken from {before}" if before not in {"", who} else "you have control")  # noqa: FBT003
            case Act.RELEASE_CONTROL:
                had = self.control.of(name) == who
                if had:
                    self._bring_to_rest(name, f"{who} gave up control", now_ns)
                    self.control.release(name, who)
                reply(had, "nobody has control now" if had else "you did not have control")
            case Act.DISMISS:
                self._bring_to_rest(name, f"{who} dismissed the robot", now_ns)
                self.control.release(name, who)
                self.fleet.dismiss(name)
                reply(True, "dismissed; it is shown again as soon as it is heard")  # noqa: FBT003
            case Act.BREAK_OFF:
                is_over = tasks.break_off(f"{who} broke it off", now_ns)
                reply(is_over, "broken off" if is_over else "nothing is being played")
            case Act.TRY:
                self._refuse("no trial", reply, "only a simulated robot can be tried out: segway-ecc demo")
            case Act.PLAY if isinstance(submitted.manoeuvre, Manoeuvre):
                self._bring_to_rest(name, "another sequence was started", now_ns)
                tasks.playback = SequencePlayback(submitted.manoeuvre, submitted.command.name, reply, now_ns)

    def _continue_sequence(self, robot: Robot, tasks: RobotTasks, playback: SequencePlayback, now_ns: int) -> None:
        was_over, before = playback.is_over, playback.outcome
        if not was_over and not robot.is_alive:
            tasks.break_off("the robot is lost", now_ns)
        elif not was_over and not robot.is_active:
            tasks.break_off(f"the robot went to {robot.mode.mode}: {robot.mode.reason}", now_ns)
        else:
            playback.step(tasks.connection, robot.newest(Odometry, now_ns), now_ns)
            if playback.is_over and playback.outcome != before:
                tasks.log_outcome(playback)

    def _view(self, name: str, now_ns: int) -> RobotView:
        robot, tasks, stop = self.fleet.robots.get(name), self._tasks.get(name), self._stops[name]
        if robot is None:
            view = RobotView(robot=name, reason="not found yet: it is stopped as soon as it is")
        else:
            view = robot.view(now_ns, self._beats)
        return msgspec.structs.replace(
            view,
            stop=stop.state.value,
            stop_after_s=stop.after_s,
            controller=self.control.of(name),
            sequence=tasks.playback.view if tasks is not None and tasks.playback is not None else None,
        )

    def _stop_of(self, name: str) -> Stop:
        return self._stops.setdefault(name, Stop(self._log_of(name)))

    def _log_of(self, name: str) -> Callable[[str, str], None]:
        return lambda text, level: self._events.add(name, text, level=level)

    def _cancel_stop(self, who: str, name: str, reply: Reply) -> None:
        stop, refusal = self._stops[name], self.control.refusal(name, who, Act.CANCEL_STOP)
        if refusal is not None:
            self._refuse("control", reply, refusal)
        elif stop.state is not StopState.REQUESTED:
            self._refuse("no stop", reply, "no stop is pending there; a confirmed one ends when the fault is cleared")
        else:
            stop.cancel(f"{who} took it back before it was confirmed")
            if name not in self._tasks:
                del self._stops[name]
            reply(True, "the stop is no longer sent; if it has arrived, the robot stays in FAULT")  # noqa: FBT003

    def _bring_to_rest(self, name: str, reason: str, now_ns: int) -> None:
        self._dead_man.release(name, now_ns)
        self._tasks[name].break_off(reason, now_ns)

    def _refuse(self, cause: str, reply: Reply, text: str) -> None:
        self.refused[f"command: {cause}"] += 1
        reply(False, text)  # noqa: FBT003 - the contract's form

    def _logged(self, submitted: SubmittedCommand) -> Reply:
        """A reply that logs the outcome of a command as an event, too."""
        act = submitted.command.act

        def reply(accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
            level = ("warning" if accepted else "error") if act is Act.STOP else ("info" if accepted else "warning")
            what = f"{act}: {'' if accepted else 'failed: '}{text}"
            self._events.add(submitted.command.robot[:100], what, level=level, who=submitted.who)
            submitted.reply(accepted, text)

        return reply


def _dismissal_refusal(robot: Robot, tasks: RobotTasks) -> tuple[str, str] | None:
    """The cause and the text of why a robot is to stay in sight."""
    if robot.is_alive:
        return "not lost", "the robot is not lost: only one that is can be dismissed"
    if tasks.stop.state is StopState.REQUESTED:
        return "stopped", "its stop is not confirmed: it is sent until it is, or until you clear it"
    return None

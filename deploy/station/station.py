# SPDX-License-Identifier: MIT
"""The base station's connection to the robots: one thread for their network, and methods for every other thread."""

import datetime as dt
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final, Self

import msgspec

from segway_ecc.deploy.station.command_handler import CommandHandler, SubmittedCommand
from segway_ecc.deploy.station.fleet import EventLog, Heartbeats
from segway_ecc.deploy.station.kept_stops import KeptStop, KeptStops
from segway_ecc.deploy.station.network import Connect, RobotNetwork
from segway_ecc.deploy.station.requests import Reply, once
from segway_ecc.deploy.station.ros_bridge import ros_network
from segway_ecc.deploy.station.sequences import read_sequence
from segway_ecc.deploy.station.views import Act, Command, Drive, EventView, FleetView, TrialView
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import ConfigurationError, RosUnavailableError, shortened
from segway_ecc.node.sequence.manoeuvre import Manoeuvre

_TICK_NS: Final = 50_000_000
_WAITING_S: Final = 0.004
"""How often a robot is polled whose confirmation is awaited."""
_MOST_COMMANDS: Final = 256
_MOST_SEQUENCES: Final = 4
_ENDS_WITHIN_S: Final = 5.0
_MOST_FAILURES: Final = 100
_ENDS: Final = "the station ends"
OVER_ROS: Final[Connect] = partial(ros_network, ())
_logger = logging.getLogger(__name__)


class Station:
    """The robots on a network, and the commands to them. Every method may be called from any thread."""

    limits: Final = Setpoint(3.0, 6.0)
    """The fastest that an operator may request: m/s, rad/s. A robot may allow less."""
    trials: Final[Sequence[TrialView]] = ()
    """None: what is done to a simulated robot, its own station does."""

    def __init__(
        self,
        name: str,
        connect: Connect = OVER_ROS,
        *,
        is_watching: bool = False,
        folder: Path | None = None,
    ) -> None:
        """Prepare a station; entering its context starts it.

        Args:
            name: Its name in the robots' reports.
            connect: Connects it to its robots.
            is_watching: Whether it only watches: then it sends no heartbeats, so no robot comes to rely on it.
            folder: Where stops are kept until they are confirmed; without it they end with this process.
        """
        self._events = EventLog(time.time_ns)
        beats = Heartbeats(name)
        self._handler = CommandHandler(self._events, beats, self.limits)
        self._connect = connect
        self._beats = None if is_watching else beats
        self._kept = None if folder is None else KeptStops(folder, self._log_failure)
        self._failures: set[str] = set()
        self._pending: dict[str, KeptStop] = {}
        self._stops: deque[SubmittedCommand] = deque()
        self._commands: deque[SubmittedCommand | str] = deque()
        self._drives: dict[tuple[str, str], tuple[Drive, int]] = {}
        self._reading = threading.Semaphore(_MOST_SEQUENCES)
        self._readers = ThreadPoolExecutor(1, "sequences")
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._has_begun = threading.Event()
        self._is_ending = False
        self._failure: RosUnavailableError | None = None
        self._picture = FleetView(time_s=0.0, robots=())
        self._refused: Mapping[str, int] = {}
        self._thread = threading.Thread(target=self._run, name="station", daemon=True)

    def __enter__(self) -> Self:
        """Start the thread, and connect.

        Raises:
            RosUnavailableError: ROS is not there or does not start.
        """
        if self._kept is not None:
            for robot, stop in self._kept.load().items():
                self._restore(robot, stop)
        self._thread.start()
        self._has_begun.wait()
        if self._failure is not None:
            raise self._failure
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Bring what moves by us to rest, answer every command, and end the thread."""
        with self._lock:
            self._is_ending = True
        self._wake.set()
        if self._thread.ident is not None:
            self._thread.join(_ENDS_WITHIN_S)
        if self._kept is not None:
            self._kept.close()
        self._readers.shutdown()
        self._answer_late()

    def fleet(self) -> FleetView:
        """The newest picture; never waits."""
        return self._picture

    def refused(self) -> Mapping[str, int]:
        """Commands, set-points and messages that were refused or clamped, by cause; never waits."""
        return self._refused

    def events(self, after: int) -> Sequence[EventView]:
        """The events that are kept and whose number is greater than `after`."""
        return self._events.after(after)

    def submit(self, who: str, command: Command, reply: Reply) -> None:
        """Have an operator's command carried out.

        `reply` is called once, from another thread, with whether it was confirmed and the text. Where the station is
        ending or has too much to do it is called at once, from this thread.
        """
        submitted = SubmittedCommand(who, command, once(reply), time.monotonic_ns())
        if command.act is not Act.PLAY:
            self._enqueue(submitted)
        elif not self._reading.acquire(blocking=False):
            submitted.reply(False, "other sequences are still being read; try again")  # noqa: FBT003
        else:
            try:
                # In a thread of its own: a long sequence takes a second.
                self._readers.submit(self._read, submitted)
            except RuntimeError:  # it was shut down
                self._reading.release()
                submitted.reply(False, _ENDS)  # noqa: FBT003 - the contract's form

    def drive(self, who: str, drive: Drive) -> None:
        """Have a robot driven; the newest of each operator for each robot wins."""
        with self._lock:
            if len(self._drives) < _MOST_COMMANDS or (who, drive.robot) in self._drives:
                self._drives[who, drive.robot] = (drive, time.monotonic_ns())
        self._wake.set()

    def leave(self, who: str) -> None:
        """An operator's browser is gone: they lose control, and what they drove is brought to rest."""
        with self._lock:
            self._drives = {key: drive for key, drive in self._drives.items() if key[0] != who}
            self._commands.append(who)
        self._wake.set()

    def _enqueue(self, submitted: SubmittedCommand) -> None:
        with self._lock:
            waiting = self._stops if submitted.command.act is Act.STOP else self._commands
            if self._is_ending:
                refusal = _ENDS
            elif len(waiting) >= _MOST_COMMANDS:
                refusal = "the station has too much to do"
            else:
                refusal = ""
                waiting.append(submitted)
        self._wake.set()
        if refusal:
            submitted.reply(False, refusal)  # noqa: FBT003 - the contract's form

    def _read(self, submitted: SubmittedCommand) -> None:
        command = submitted.command
        manoeuvre: Manoeuvre | str
        try:
            manoeuvre = read_sequence(command.text, command.name[:80] or "the sequence", self.limits)
        except ConfigurationError as error:
            manoeuvre = str(error)
        except Exception as error:  # whatever it is, who asked is waiting for an answer
            _logger.exception("a sequence could not be read, and the station goes on")
            manoeuvre = shortened(f"the station failed to read it: {type(error).__name__}: {error}")
        finally:
            self._reading.release()
        self._enqueue(SubmittedCommand(submitted.who, command, submitted.reply, submitted.at_ns, manoeuvre))

    def _run(self) -> None:
        try:
            with self._connect(self._handler, self._beats, self._events) as network:
                self._has_begun.set()
                next_tick_ns = time.monotonic_ns()
                while not self._is_ending:
                    now_ns = time.monotonic_ns()
                    self._carry_out()
                    is_tick = now_ns >= next_tick_ns
                    self._guarded(self._step, network, is_tick)
                    if is_tick:
                        next_tick_ns = max(next_tick_ns + _TICK_NS, now_ns)
                    wait_s = max(next_tick_ns - time.monotonic_ns(), 0) * 1e-9
                    self._wake.wait(min(wait_s, _WAITING_S) if network.is_waiting else wait_s)
                    self._wake.clear()
                self._guarded(lambda: self._handler.close(time.monotonic_ns()))
                self._guarded(network.flush)
        except RosUnavailableError as error:
            self._failure = error
        finally:
            self._answer_late()
            self._has_begun.set()

    def _step(self, network: RobotNetwork, is_tick: bool) -> None:  # noqa: FBT001 - passed through by `_guarded`
        # A message that makes this fail must not keep stops from being sent again.
        self._guarded(lambda: network.poll(everything=is_tick))
        now_ns = time.monotonic_ns()
        self._handler.step(now_ns)
        self._keep_stops()
        if is_tick:
            network.beat(now_ns)
            self._picture = self._view(now_ns)
            self._refused = dict(self._handler.refused) | dict(network.refused())
            network.discover(now_ns)

    def _view(self, now_ns: int) -> FleetView:
        picture = self._handler.view(now_ns)
        kept = {} if self._kept is None else self._kept.on_disk
        robots = [msgspec.structs.replace(robot, stop_kept=robot.robot in kept) for robot in picture.robots]
        return msgspec.structs.replace(picture, robots=robots)

    def _keep_stops(self) -> None:
        pending = self._handler.pending_stops()
        if self._kept is not None and pending.keys() != self._pending.keys():
            self._pending = {
                name: self._pending.get(name) or KeptStop(who, time.time_ns()) for name, who in pending.items()
            }
            self._kept.keep(self._pending)

    def _restore(self, robot: str, stop: KeptStop) -> None:
        """Deliver a stop that an earlier station could not."""
        self._pending[robot] = stop
        when = dt.datetime.fromtimestamp(stop.wall_ns // 1_000_000_000, dt.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        text = f"stop of {stop.who}, {when}, was not confirmed before this station started: it is sent until it is"
        self._events.add(robot, text, level="warning", who=stop.who)
        self._enqueue(
            SubmittedCommand(stop.who, Command(id=1, robot=robot, act=Act.STOP), _no_reply, time.monotonic_ns())
        )

    def _log_failure(self, text: str) -> None:
        self._events.add("", text, level="error")

    def _carry_out(self) -> None:
        """What operators submitted since the last step: stops before everything else."""
        with self._lock:
            stops, self._stops = self._stops, deque()
            commands, self._commands = self._commands, deque()
            drives, self._drives = self._drives, {}
        for item in (*stops, *commands):
            if isinstance(item, str):
                self._guarded(self._handler.leave, item, time.monotonic_ns())
                continue
            carry_out = self._handler.stop if item.command.act is Act.STOP else self._handler.command
            if not self._guarded(carry_out, item, time.monotonic_ns()):
                item.reply(False, "the station failed; see its messages")  # noqa: FBT003 - the contract's form
        for (who, _), (drive, at_ns) in drives.items():
            self._guarded(self._handler.drive, who, drive, at_ns, time.monotonic_ns())

    def _guarded(self, function: Callable[..., None], *arguments: object) -> bool:
        """Whether it succeeded; what fails for one command or robot must not take the next stop with it."""
        try:
            function(*arguments)
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            if text not in self._failures and len(self._failures) < _MOST_FAILURES:
                self._failures.add(text)
                self._events.add("", f"the station failed: {text}", level="error")
                _logger.exception("the station failed and goes on")
            return False
        return True

    def _answer_late(self) -> None:
        with self._lock:
            self._is_ending = True
            late = [*self._stops, *(item for item in self._commands if isinstance(item, SubmittedCommand))]
            self._stops, self._commands = deque(), deque()
        for submitted in late:
            submitted.reply(False, _ENDS)  # noqa: FBT003 - the contract's form


def _no_reply(accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
    """Whoever asked is gone; the event log has the outcome."""

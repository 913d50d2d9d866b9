# SPDX-License-Identifier: MIT
"""The ROS side of the archives, with the parameters of `archive_files`: a robot's server, and a base station's calls.

The server hands out pieces when they are asked for, and no faster than is good for others; the calls have a thread and
a ROS context of their own, apart from the robots' connections.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Final, NamedTuple

from segway_ecc.deploy.support.archive_files import NODE, Value, piece_of, words_of
from segway_ecc.node.errors import NobodyListensError, NodeError
from segway_ecc.node.ros.messages import RosObject, message_type
from segway_ecc.node.ros.runtime import ros_node, steady_executor

SERVICE: Final = "get_parameters"
_MOST_NAMES: Final = 4
_LONGEST_NAME: Final = 300
_LOOK_S: Final = 0.1
_STRING: Final = 4
_INTEGERS: Final = 7
_STRINGS: Final = 9
"""rcl_interfaces/msg/ParameterType."""
_POLL_S: Final = 0.05
_FOUND_WITHIN_S: Final = 4.0
"""DDS takes up to that long to find a service on a busy machine."""
_KNOWN_WITHIN_S: Final = 1.0
"""And that long once it has looked around for a while."""
_ANSWER_S: Final = 5.0
_MOST_WAITING: Final = 64
_MOST_ROBOTS: Final = 100


class ArchiveServer:
    """Answers requests for parameters, in a loop of its own."""

    def __init__(self, node: RosObject, answer: Callable[[str], Value], bytes_per_s: float) -> None:
        """Answer through `node`, which has no parameter services of its own; `answer` knows a parameter's value."""
        self._node = node
        self._answer = answer
        self._bytes_per_s = bytes_per_s
        self._owed_s = 0.0
        self._value_type = message_type("rcl_interfaces/msg/ParameterValue")
        service_type = message_type("rcl_interfaces/srv/GetParameters")
        node.create_service(service_type, f"~/{SERVICE}", self._serve)

    def run(self, stopped: Callable[[], bool]) -> None:
        """Answer until `stopped`, which is asked often, is true."""
        with steady_executor(self._node) as executor:
            while not stopped():
                executor.spin_once(timeout_sec=_LOOK_S)
                # Whatever was sent is waited for before the next request is even looked at, whoever's it is.
                while self._owed_s > 0.0 and not stopped():
                    pause_s = min(self._owed_s, _LOOK_S)
                    time.sleep(pause_s)
                    self._owed_s -= pause_s

    def _serve(self, request: RosObject, response: RosObject) -> RosObject:
        response.values = [self._value_type() for _ in request.names]
        for name, value in zip(request.names[:_MOST_NAMES], response.values, strict=False):
            answer = self._answer(name) if len(name) <= _LONGEST_NAME else None
            if isinstance(answer, bytes):
                self._owed_s += len(answer) / self._bytes_per_s
                value.type, value.integer_array_value = _INTEGERS, words_of(answer)
            elif isinstance(answer, str):
                value.type, value.string_value = _STRING, answer
            elif answer is not None:
                value.type, value.string_array_value = _STRINGS, [str(line) for line in answer]
                self._owed_s += sum(len(line) for line in value.string_array_value) / self._bytes_per_s
        return response


def value_of(value: RosObject) -> Value:
    """What a `rcl_interfaces/msg/ParameterValue` holds; None for a type that no archive sends."""
    if value.type == _STRING:
        return str(value.string_value)
    if value.type == _STRINGS:
        return list(value.string_array_value)
    return piece_of(value.integer_array_value) if value.type == _INTEGERS else None


class NoArchiveError(NobodyListensError):
    """A robot hands out nothing; the text names what to start there."""

    def __init__(self, robot: str) -> None:
        more = "" if robot == "/" else f" --namespace {robot}"
        super().__init__(f"robot {robot} hands out nothing; on the robot, start: segway-ecc log archive ROBOT{more}")


class _Call(NamedTuple):
    robot: str
    name: str
    answer: "Future[Value]"
    asked_s: float


class ArchiveCalls:
    """Asks for parameters of archives. `ask` may be called from any thread but one that must not wait."""

    def __init__(self, ros_arguments: Sequence[str] = ()) -> None:
        """Prepare; ROS is begun by the first question, and stays."""
        self._ros_arguments = ros_arguments
        self._calls: deque[_Call] = deque()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._wake: RosObject = None
        self._is_ending = False

    def ask(self, robot: str, name: str) -> Value:
        """The value of a parameter of the archive in a namespace; waits a few seconds at most.

        Raises:
            NoArchiveError: There is no archive.
            NodeError: It gave no answer, or nobody can be asked.
        """
        call = _Call(robot, name, Future(), time.monotonic())
        with self._lock:
            if self._is_ending:
                raise NobodyListensError("the station ends")
            if len(self._calls) >= _MOST_WAITING:
                raise NobodyListensError("too much is asked of the robots' archives at once; try again")
            self._calls.append(call)
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._run, name="archives", daemon=True)
                self._thread.start()
            wake = self._wake
        _trigger(wake)
        try:
            return call.answer.result(_FOUND_WITHIN_S + _ANSWER_S + 1.0)
        except TimeoutError:
            raise NobodyListensError(f"the archive of robot {robot} gave no answer") from None

    def close(self) -> None:
        """End the thread; what is waited for fails, and later calls of `ask`."""
        with self._lock:
            self._is_ending = True
            thread, wake = self._thread, self._wake
        _trigger(wake)
        if thread is not None:
            thread.join(_ANSWER_S)

    def _run(self) -> None:
        failure: Exception = NobodyListensError("the station ends")
        try:
            with ros_node("station_archive", "", self._ros_arguments) as node, steady_executor(node) as executor:
                exchange = _Exchange(node, executor)
                with self._lock:
                    self._wake = exchange.wake
                while not self._is_ending:
                    exchange.step(self._taken())
                with self._lock:
                    self._wake = None
                exchange.fail("the station ends")
        except Exception as error:  # noqa: BLE001 - whoever asks gets it
            failure = error if isinstance(error, NodeError) else NobodyListensError(f"ROS failed: {error}")
        finally:
            with self._lock:
                self._wake = None
            for call in self._taken():
                call.answer.set_exception(failure)

    def _taken(self) -> list[_Call]:
        with self._lock:
            calls = list(self._calls)
            self._calls.clear()
        return calls


def _trigger(wake: RosObject) -> None:
    if wake is not None:
        with contextlib.suppress(Exception):  # it is being destroyed
            wake.trigger()


class _Exchange:
    """What belongs to the thread that runs ROS."""

    def __init__(self, node: RosObject, executor: RosObject) -> None:
        self._type = message_type("rcl_interfaces/srv/GetParameters")
        self._node = node
        self._executor = executor
        self._clients: dict[str, RosObject] = {}
        self._begun_s = time.monotonic()
        self._unsent: list[_Call] = []
        self._sent: list[tuple[_Call, RosObject, RosObject]] = []
        self.wake = node.create_guard_condition(lambda: None)

    def step(self, calls: Sequence[_Call]) -> None:
        """Send what can be sent, receive what has come, and give up what has taken too long."""
        now_s = time.monotonic()
        unsent, self._unsent = [*self._unsent, *calls], []
        for call in unsent:
            client = self._clients.get(call.robot)
            if client is None and len(self._clients) < _MOST_ROBOTS:
                client = self._node.create_client(self._type, f"{call.robot.rstrip('/')}/{NODE}/{SERVICE}")
                self._clients[call.robot] = client
            until_s = max(self._begun_s + _FOUND_WITHIN_S, call.asked_s + _KNOWN_WITHIN_S)
            if client is not None and client.service_is_ready():
                future = client.call_async(self._type.Request(names=[call.name]))
                self._sent.append((call._replace(asked_s=now_s), client, future))
            elif now_s < until_s and client is not None:
                self._unsent.append(call)
            else:
                call.answer.set_exception(NoArchiveError(call.robot))
        self._executor.spin_once(timeout_sec=_POLL_S)
        now_s = time.monotonic()
        sent, self._sent = self._sent, []
        for call, client, future in sent:
            if future.done():
                try:
                    values = future.result().values
                    call.answer.set_result(value_of(values[0]) if len(values) == 1 else None)
                except Exception as error:  # noqa: BLE001 - whoever asked gets it
                    failure = NobodyListensError(f"the archive of robot {call.robot} failed: {error}")
                    call.answer.set_exception(failure)
            elif now_s < call.asked_s + _ANSWER_S:
                self._sent.append((call, client, future))
            else:
                client.remove_pending_request(future)
                call.answer.set_exception(NobodyListensError(f"the archive of robot {call.robot} gave no answer"))

    def fail(self, why: str) -> None:
        for call in (*self._unsent, *(call for call, _, _ in self._sent)):
            call.answer.set_exception(NobodyListensError(why))

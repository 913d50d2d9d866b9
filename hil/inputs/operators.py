# SPDX-License-Identifier: MIT
"""Item 8: operators, base stations, and others in ROS."""

import contextlib
import queue
import re
import socket
import time
import urllib.request
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Final

from segway_ecc.deploy.station.ros_bridge import MODE_TOPIC, MODE_TYPE
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.views import Act, Command
from segway_ecc.hil.inputs.needs import no_ros, no_station
from segway_ecc.hil.inputs.rig import Arrangement, Rig
from segway_ecc.hil.inputs.trial import Do, Event, InputTrial, balances, falls
from segway_ecc.hil.processes import ProcessFailedError, command
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import ros_node

_ITEM: Final = 8
_REPLIES_WITHIN_S: Final = 40.0
_PAGE_WITHIN_S: Final = 10.0
_OK: Final = 200
_SLOW: Final = 512
_ADDRESSES: Final = ("127.0.0.2", "127.0.0.3", "127.0.0.4")
_FOUND_WITHIN_S: Final = 10.0
"""The station finds the robot in this time, and its stop then takes effect."""
_STOPS_WITHIN_S: Final = 0.5
"""A stop that is lost is sent again after 0.1 s."""
_ROS: Final = Arrangement(ros=True)
_BOMB: Final = "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9 if n else ['x'] * 9)}]\n" for n in range(9))
_HEX: Final = "segments: [{linear: 0x" + "f" * 6000 + ", duration: 1}]"


def _submit(station: Station, rig: Rig, act: Act, text: str = "") -> str:
    """Give a command, and wait for its outcome.

    Raises:
        ProcessFailedError: There was none.
    """
    outcomes: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()
    station.submit(
        "ann",
        Command(id=1, robot=rig.namespace, act=act, text=text, name="one"),
        lambda *outcome: outcomes.put((bool(outcome[0]), str(outcome[1]))),
    )
    try:
        accepted, answer = outcomes.get(timeout=_REPLIES_WITHIN_S)
    except queue.Empty:
        raise ProcessFailedError(f"the station did not answer '{act}' within {_REPLIES_WITHIN_S:g} s") from None
    return f"{act}: {'done' if accepted else 'refused'}: {answer}"


def _stop_while_away(rig: Rig, undo: ExitStack) -> Event:
    station = undo.enter_context(Station("base", folder=rig.file.parent))
    now_ns = time.monotonic_ns()  # the station does not know any robot yet
    return Event(now_ns, [_submit(station, rig, Act.STOP)])


def _stop_beside_publisher(rig: Rig, undo: ExitStack) -> Event:
    """A node whose name is before that of the model node publishes `mode`, and is there before the station looks."""
    node = undo.enter_context(ros_node("another", rig.namespace))
    node.create_publisher(message_type(MODE_TYPE), MODE_TOPIC, 1)
    station = _station_that_found(rig, undo)

    def reports() -> list[str]:
        return [event.text for event in station.events(0) if event.text.startswith("another publishes mode")]

    rig.wait(reports, "the station did not report the other publisher")
    now_ns = time.monotonic_ns()
    return Event(now_ns, [_submit(station, rig, Act.STOP), *reports()])


def _station_that_found(rig: Rig, undo: ExitStack) -> Station:
    station = undo.enter_context(Station("base", folder=rig.file.parent))

    def is_found() -> bool:
        return any(robot.robot == rig.namespace for robot in station.fleet().robots)

    rig.wait(is_found, "the station did not find the robot")
    return station


def _play(text: str) -> Do:
    def do(rig: Rig, undo: ExitStack) -> Event:
        station = _station_that_found(rig, undo)
        now_ns = time.monotonic_ns()
        return Event(now_ns, [_submit(station, rig, Act.PLAY, text)])

    return do


def _slow_connections(rig: Rig, undo: ExitStack) -> Event:
    messages, folder = rig.parts.setup.messages("station"), rig.file.parent
    words = ["station", "serve", "--name", "base", "--port", "0", "--folder", str(folder), "--logs", str(folder)]
    undo.enter_context(command(words, messages))
    found: list[str] = []

    def has_address() -> bool:
        found[:] = re.findall(r"open http://127\.0\.0\.1:(\d+)/", messages.read_text(encoding="utf-8"))
        return bool(found)

    rig.wait(has_address, "the station does not serve")
    port, now_ns = int(found[0]), time.monotonic_ns()
    for number in range(_SLOW):
        source = _ADDRESSES[number % len(_ADDRESSES)]
        slow = undo.enter_context(contextlib.closing(socket.create_connection(("127.0.0.1", port), 5.0, (source, 0))))
        slow.sendall(b"GET / HTTP/1.1\r\nHost: ")
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=_PAGE_WITHIN_S) as page:
            answer = f"the page was served: {page.status}"
    except OSError as error:
        answer = f"the page was not served: {error}"
    return Event(now_ns, [answer])


def _heartbeat(rig: Rig, _undo: ExitStack) -> Event:
    now_ns = rig.ros.publish("std_msgs/msg/Header", "station", 1, frame_id="stranger")
    rig.ros.spin(0.5)
    mode = rig.ros.mode
    return Event(now_ns, [f"heartbeat of '{mode['heartbeat'].partition(' ')[0]}', introduced: {mode['introduced']}"])


def _second_mode(rig: Rig, _undo: ExitStack) -> Event:
    return Event(rig.ros.publish(MODE_TYPE, MODE_TOPIC, 20, name="somebody: mode"))


def trials() -> Sequence[InputTrial]:
    """All of them."""
    stays = [
        ("one heartbeat of a station that nobody introduced", _heartbeat, "'stranger', introduced: false", no_ros),
        ("a sequence with nested aliases (YAML bomb)", _play(_BOMB), "play: refused: .*alias", no_ros),
        ("a sequence with a number of 6,000 hexadecimal digits", _play(_HEX), "play: refused: ", no_ros),
        ("512 slow connections to the station from three addresses", _slow_connections, f": {_OK}$", no_station),
        ("somebody else publishes on mode", _second_mode, "mode.* published by|publishes .*mode", no_ros),
    ]
    return [
        *(
            InputTrial(_ITEM, name, do, balances(reason), _ROS, look_s=2.5, needs=needs)
            for name, do, reason, needs in stays
        ),
        InputTrial(
            _ITEM,
            "a stop at a station that has not found the robot yet",
            _stop_while_away,
            falls("^FAULT.*stop was pressed", _FOUND_WITHIN_S),
            _ROS,
            needs=no_ros,
        ),
        InputTrial(
            _ITEM,
            "a stop, where another node publishes on mode that is no robot",
            _stop_beside_publisher,
            falls("stop: done: stopped after .*stop was pressed", _STOPS_WITHIN_S),
            _ROS,
            needs=no_ros,
        ),
    ]

# SPDX-License-Identifier: MIT
"""The process at the terminal: argument DESCRIPTOR, the other end of the loop's socket.

It is a process of its own so that neither drawing nor a terminal that hangs can delay the loop.
"""

import contextlib
import math
import os
import select
import signal
import socket
import sys
import termios
import tty
from collections.abc import Iterator
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from segway_ecc.hil.play.channel import ACTS, Key, Snapshot, TerminalEnd, is_begun, keys_in
from segway_ecc.hil.play.keys import KEYS

_DRAW_EVERY_S: Final = 0.1
_REST_WITHIN_S: Final = 0.05
"""The second half of a key, as over a slow line; the escape key alone waits for as long."""
_MOST_BYTES: Final = 1024
_COLOURS = {"ARMED": "bold green", "HOLD": "bold yellow", "FAULT": "bold red", "DISARMED": "bold"}
_MARKS: Final = {"ArrowUp": "up", "ArrowDown": "down", "ArrowLeft": "left", "ArrowRight": "right", "Escape": "Esc"}
_IN_FIRST_LINE: Final = frozenset({"ahead", "back", "left", "right", "rest", "stop"})


@contextlib.contextmanager
def raw(descriptor: int) -> Iterator[None]:
    """Have keys at once and unseen, Ctrl-C as a key; put the terminal back when the context is left."""
    before = termios.tcgetattr(descriptor)
    tty.setraw(descriptor)
    changed = termios.tcgetattr(descriptor)
    changed[1] = before[1]  # what is drawn still needs its line ends made
    termios.tcsetattr(descriptor, termios.TCSADRAIN, changed)
    try:
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def serve(end: TerminalEnd, descriptor: int, console: Console) -> None:
    """Draw and send keys until the loop, or the terminal, is gone."""
    newest = None
    with raw(descriptor), Live(console=console, screen=True, auto_refresh=False) as live:
        while not end.is_gone:
            if select.select([descriptor], [], [], _DRAW_EVERY_S)[0]:
                keys = pressed(descriptor)
                if keys is None:
                    return
                for key in keys:
                    end.press(key)
            end.press(Key.ALIVE)
            newest = end.newest() or newest
            live.update(picture(newest), refresh=True)


def pressed(descriptor: int) -> list[Key] | None:
    """The keys that a terminal has to be read; None where it is gone."""
    data = os.read(descriptor, _MOST_BYTES)
    if not data:
        return None
    if is_begun(data) and select.select([descriptor], [], [], _REST_WITHIN_S)[0]:
        data += os.read(descriptor, _MOST_BYTES)
    return keys_in(data)


def main() -> int:
    """Run as a process; it ends with the loop, so signals are left to the loop."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with socket.socket(fileno=int(sys.argv[1])) as end, contextlib.suppress(OSError):
        end.setblocking(False)  # noqa: FBT003 - the standard library's signature
        serve(TerminalEnd(end), sys.stdin.fileno(), Console())
    return 0


def picture(snapshot: Snapshot | None) -> RenderableType:
    """What the terminal shows; before the first snapshot, that it waits."""
    if snapshot is None:
        return Panel("the robot starts ...", title="segway-ecc play")
    rows = Table.grid(padding=(0, 2))
    for name, text in _rows(snapshot):
        rows.add_row(Text(name, style="dim"), text)
    messages = Text("\n".join(snapshot.messages))
    return Panel(
        Group(rows, Text(), messages, Text(), Text("\n".join(_keys(snapshot)))),
        title=f"segway-ecc play {snapshot.robot}",
    )


def _keys(snapshot: Snapshot) -> list[str]:
    """The keys that do something now, in two lines."""
    acts = ACTS - {Key.CUT if snapshot.is_bus_broken else Key.REPAIR}
    acts -= set() if snapshot.can_be_pushed else {Key.PUSH}
    acts -= set() if snapshot.posture is not None else {Key.STAND, Key.SIT}
    lines: tuple[list[str], list[str]] = ([], [])
    for act, keys, words in KEYS:
        if act in acts:
            lines[act not in _IN_FIRST_LINE].append(f"{', '.join(_MARKS.get(key, key) for key in keys)} {words}")
    return ["   ".join(line) for line in lines]


def _rows(snapshot: Snapshot) -> list[tuple[str, Text]]:
    rows = [("mode", Text.assemble((snapshot.mode, _COLOURS.get(snapshot.mode, "")), f"  {snapshot.reason}"))]
    if snapshot.pitch is not None:
        rows.append(("tilt", Text(f"{math.degrees(snapshot.pitch):+7.2f} deg")))
    if snapshot.posture is not None:
        rows.append(("posture", Text(snapshot.posture)))
    links = _named(snapshot.links) + ("" if snapshot.line is None else f"   commands go over {snapshot.line}")
    is_well = all(state == "active" for state in snapshot.links.values()) and not snapshot.is_bus_broken
    links += "   (bus broken by hand)" if snapshot.is_bus_broken else ""
    return [
        *rows,
        ("velocity", Text(_pair(snapshot.linear, snapshot.angular))),
        ("set-point", Text(_pair(snapshot.wanted_linear, snapshot.wanted_angular))),
        ("battery", Text(_named(snapshot.battery, ".bus_voltage_v", " V"))),
        ("links", Text(links, style="" if is_well else "red")),
        ("loop", Text(_named(snapshot.timing))),
        ("ROS", Text("cmd_vel drives too" if snapshot.has_ros else "not here")),
        ("guard", Text("runs") if snapshot.guard_runs else Text("has ended", style="red")),
    ]


def _pair(linear: float | None, angular: float | None) -> str:
    return f"{_number(linear)} m/s  {_number(angular)} rad/s"


def _number(value: float | None) -> str:
    return "      -" if value is None else f"{value:+7.3f}"


def _named(values: dict[str, str], ending: str = "", unit: str = "") -> str:
    return "   ".join(f"{name.removesuffix(ending)} {text}{unit}" for name, text in values.items()) or "-"


if __name__ == "__main__":
    sys.exit(main())

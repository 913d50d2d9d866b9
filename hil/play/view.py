# SPDX-License-Identifier: MIT
"""A snapshot as a picture of text."""

import math

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from segway_ecc.hil.play.channel import Snapshot

_COLOURS = {"ARMED": "bold green", "HOLD": "bold yellow", "FAULT": "bold red", "DISARMED": "bold"}
_KEYS = "arrows drive   space rest   a arm   d disarm   s STOP   c clear fault"


def picture(snapshot: Snapshot | None) -> RenderableType:
    """What the terminal shows; before the first snapshot, that it waits."""
    if snapshot is None:
        return Panel("the robot starts ...", title="segway-ecc play")
    rows = Table.grid(padding=(0, 2))
    for name, text in _rows(snapshot):
        rows.add_row(Text(name, style="dim"), text)
    others = ["u stand up, sit down"] if snapshot.posture is not None else []
    others += ["p push"] if snapshot.can_be_pushed else []
    others += ["b restore the bus" if snapshot.is_bus_broken else "b break the bus", "q quit"]
    messages = Text("\n".join(snapshot.messages))
    return Panel(
        Group(rows, Text(), messages, Text(), Text(f"{_KEYS}\n{'   '.join(others)}")),
        title=f"segway-ecc play {snapshot.robot}",
    )


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

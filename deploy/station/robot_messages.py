# SPDX-License-Identifier: MIT
"""A robot's messages, decoded from their plain values; what is not valid is None."""

import math
import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

from segway_ecc.node.cycle.report import MODE_SUFFIX
from segway_ecc.node.cycle.trajectory import TrajectoryStatus
from segway_ecc.node.errors import shortened
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import Odometry

_CHECK: Final = "check."
_OK: Final = "ok: "
_LINK: Final = re.compile(r"link\.(?:(\w+)\.)?([\w.]+)")
_LINKS: Final = frozenset({"can", "serial"})
_DRIVES: Final = frozenset({"on", "off", "none", "unconfirmed"})
_BEAT: Final = re.compile(r"(.+) ([0-9]{1,19})", re.DOTALL)
_POSTURES: Final = {str(posture): posture for posture in Posture}
_MOST_VALUES: Final = 200
_MOST_LINKS: Final = 8
_NS_PER_MS: Final = 1e6
_ENCAPSULATION: Final = 4
_COVARIANCE: Final = 36 * 8


class ModeReport(NamedTuple):
    """The robot's message on the topic `mode`.

    Attributes:
        name: Its name in the robot file.
        drives: `on`, `off` where every drive reports so itself, `unconfirmed` where one does not, or `none`.
        is_zero: Whether the commands of its newest cycle were all zero; None where it does not report that.
        station: Whose heartbeat it received last, `beat_age_ns` ago and stamped `beat_ns`; empty for nobody's.
        is_out_of_turn: Whether its publisher's count of messages went back: the robot was started anew, or another node
            publishes `mode` too.
        is_introduced: Whether the heartbeats of `station` count.
        posture: What a robot that stands up and sits down by command is doing; None for any other.
    """

    name: str
    mode: Mode
    reason: str
    drives: str = ""
    is_zero: bool | None = None
    station: str = ""
    beat_ns: int = 0
    beat_age_ns: int = 0
    is_introduced: bool = False
    posture: Posture | None = None
    is_out_of_turn: bool = False

    @property
    def can_stand(self) -> bool:
        """Whether it can stand up and sit down by command."""
        return self.posture is not None

    @property
    def is_stopped(self) -> bool:
        """Whether it is in FAULT, and its drives report that they are off; without drives its commands are zero."""
        return self.mode is Mode.FAULT and (self.drives == "off" or (self.drives == "none" and self.is_zero is True))


class SetpointReport(NamedTuple):
    """A set-point that came into force: stamp, ns since the Unix epoch; m/s; rad/s."""

    stamp_ns: int
    linear: float
    angular: float


class Pitch(NamedTuple):
    """Forward lean, rad."""

    pitch: float


class Supply(NamedTuple):
    """Of the battery, V."""

    volts: float


@dataclass(frozen=True, slots=True)
class Health:
    """The robot's diagnostics: see `RobotView`."""

    checklist: Mapping[str, str]
    links: Mapping[str, Mapping[str, str]]
    timing: Mapping[str, str]
    tilt_limit_rad: float | None = None
    down_rad: float | None = None


RobotMessage: TypeAlias = ModeReport | Odometry | SetpointReport | TrajectoryStatus | Pitch | Supply | Health


def decode_mode(name: str, values: Mapping[str, str]) -> ModeReport | None:
    """Decode a message of the topic `mode` by its status's name, `<robot>: mode`, and values; None if none of ours."""
    mode = values.get("mode", "")
    if mode not in Mode.__members__ or not name.endswith(MODE_SUFFIX):
        return None
    drives = values.get("drives", "")
    beat = _BEAT.fullmatch(values.get("heartbeat", ""))
    age_ms = _number(values.get("heartbeat_age_ms", "")) or 0.0
    return ModeReport(
        name=shortened(name.removesuffix(MODE_SUFFIX)),
        mode=Mode(mode),
        reason=shortened(values.get("reason", "")),
        drives=drives if drives in _DRIVES else "",
        is_zero={"true": True, "false": False}.get(values.get("zero", "")),
        station=beat[1] if beat else "",
        beat_ns=int(beat[2]) if beat else 0,
        beat_age_ns=round(max(age_ms, 0.0) * _NS_PER_MS),
        is_introduced=values.get("introduced", "") == "true",
        posture=_POSTURES.get(values.get("posture", "")),
    )


def decode_health(statuses: Iterable[tuple[str, Mapping[str, str]]]) -> Health:
    """Decode diagnostics: the names of the statuses, `<robot>: <part>`, and their values."""
    checklist: dict[str, str] = {}
    links: dict[str, dict[str, str]] = {}
    timing: dict[str, str] = {}
    limits: dict[str, float | None] = {}
    for name, values in statuses:
        bounded = {shortened(key): shortened(text) for key, text in list(values.items())[:_MOST_VALUES]}
        match name.rpartition(": ")[2]:
            case "mode":
                checks = {key.removeprefix(_CHECK): text for key, text in bounded.items() if key.startswith(_CHECK)}
                checklist = {check: "ok" if text.startswith(_OK) else text for check, text in checks.items()}
                limits = {limit: _positive(bounded.get(limit, "")) for limit in ("tilt_limit_rad", "down_rad")}
            case "timing":
                timing = bounded
            case "hardware":
                links = _links(bounded)
    return Health(checklist, links, timing, **limits)


def finite(value: float) -> float | None:
    """A number of the network; None where it is not finite."""
    return value if math.isfinite(value) else None


def _links(values: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Each link by its name; a robot's only link is `link`, and beside two links `link` is what joins them."""
    links: dict[str, dict[str, str]] = {}
    for key, text in values.items():
        found = _LINK.fullmatch(key)
        if key == "link":
            links.setdefault("link", {})["description"] = text
        elif found is not None:
            link, what = found.groups()
            if link is not None and link not in _LINKS:  # a dotted count, such as refused.crc
                link, what = None, f"{link}.{what}"
            if (link or "link") in links or len(links) < _MOST_LINKS:
                links.setdefault(link or "link", {})[what] = text
    return links


def _positive(text: str) -> float | None:
    number = _number(text)
    return number if number is not None and number > 0.0 else None


def _number(text: str) -> float | None:
    try:
        return finite(float(text))
    except ValueError:
        return None


def read_odometry(data: bytes) -> Odometry | None:
    """Decode a nav_msgs/Odometry; None where the bytes are not that or not finite.

    rclpy takes 0.2 ms to make one into objects, most of it for covariances. The data are the message in XCDR1, as ROS 2
    sends it (OMG DDSI-RTPS 2.3, 10.2), with its four bytes of encapsulation.
    """
    try:
        order = "<" if data[1] == 1 else ">"
        body = memoryview(data)[_ENCAPSULATION:]
        sec, nanosec = struct.unpack_from(f"{order}iI", body)
        at = _after_text(body, _after_text(body, 8, order), order)
        at = -(-at // 8) * 8
        x, y, _, _, _, z, w = struct.unpack_from(f"{order}7d", body, at)
        linear, _, _, _, _, angular = struct.unpack_from(f"{order}6d", body, at + 7 * 8 + _COVARIANCE)
    except (struct.error, IndexError):
        return None
    heading = math.remainder(2.0 * math.atan2(z, w), math.tau)
    odometry = Odometry(sec * 1_000_000_000 + nanosec, x, y, heading, linear, angular)
    return odometry if all(map(math.isfinite, odometry)) else None


def _after_text(body: memoryview, at: int, order: str) -> int:
    """Where a string that begins at the next multiple of four ends."""
    at = -(-at // 4) * 4
    (length,) = struct.unpack_from(f"{order}I", body, at)
    return int(at + 4 + length)

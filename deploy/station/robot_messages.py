"""What a robot says, decoded from the plain values of its messages; what is not as it must be is None."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

from segway_ecc.deploy.station.events import clipped
from segway_ecc.node.cycle.report import MODE_SUFFIX
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.sequence.player import Odometry

_CHECK: Final = "check."
_OK: Final = "ok: "
_LINK: Final = re.compile(r"link\.(?:(\w+)\.)?([\w.]+)")
_LINES: Final = frozenset({"can", "serial"})
_DRIVES: Final = frozenset({"on", "off", "none", "unconfirmed"})
_MOST_VALUES: Final = 200
_MOST_LINKS: Final = 8
_NS_PER_MS: Final = 1e6


class ModeReport(NamedTuple):
    """The robot's word on the topic `mode`.

    Attributes:
        name: What its file calls it.
        mode: Its mode.
        reason: Why.
        drives: `on`, `off` where every drive says so itself, `unconfirmed` where one does not, or `none`.
        is_zero: Whether the commands of its newest cycle were all zero; None where it does not tell.
        station: Whose heartbeat it heard last; empty for nobody's.
        beat_ns: The stamp of that heartbeat.
        beat_age_ns: How long ago it heard it.
        stand: What is in force of what makes it stand up (1) or sit down (0); None where it can be told neither.
    """

    name: str
    mode: Mode
    reason: str
    drives: str = ""
    is_zero: bool | None = None
    station: str = ""
    beat_ns: int = 0
    beat_age_ns: int = 0
    stand: float | None = None

    @property
    def can_stand(self) -> bool:
        """Whether it can be told to stand up and to sit down."""
        return self.stand is not None

    @property
    def is_stopped(self) -> bool:
        """Whether it is in FAULT, and its drives say that they are off; of a robot that has none its commands."""
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


RobotMessage: TypeAlias = ModeReport | Odometry | SetpointReport | Pitch | Supply | Health


def decode_mode(name: str, values: Mapping[str, str]) -> ModeReport | None:
    """Decode a message of the topic `mode`.

    Args:
        name: The name of the status, `<robot>: mode`.
        values: Its values.
    """
    mode = values.get("mode", "")
    if mode not in Mode.__members__ or not name.endswith(MODE_SUFFIX):
        return None
    drives = values.get("drives", "")
    station, beat_ns = _beat(values.get("heartbeat", ""))
    return ModeReport(
        name=clipped(name.removesuffix(MODE_SUFFIX)),
        mode=Mode(mode),
        reason=clipped(values.get("reason", "")),
        drives=drives if drives in _DRIVES else "",
        is_zero={"true": True, "false": False}.get(values.get("zero", "")),
        station=station,
        beat_ns=beat_ns,
        beat_age_ns=_ns_of_ms(values.get("heartbeat_age_ms", "")),
        stand=_number(values.get("stand", "")),
    )


def decode_health(statuses: Iterable[tuple[str, Mapping[str, str]]]) -> Health:
    """Decode diagnostics: the names of the statuses, `<robot>: <part>`, and their values."""
    checklist: dict[str, str] = {}
    links: dict[str, dict[str, str]] = {}
    timing: dict[str, str] = {}
    for name, values in statuses:
        match name.rpartition(": ")[2]:
            case "mode":
                checklist = _checklist(_bounded(values))
            case "timing":
                timing = _bounded(values)
            case "hardware":
                links = _links(_bounded(values))
    return Health(checklist, links, timing)


def finite(value: float) -> float | None:
    """A number of the network; None where it is none."""
    return value if math.isfinite(value) else None


def _bounded(values: Mapping[str, str]) -> dict[str, str]:
    return {clipped(key): clipped(text) for key, text in list(values.items())[:_MOST_VALUES]}


def _checklist(values: Mapping[str, str]) -> dict[str, str]:
    items = {key.removeprefix(_CHECK): text for key, text in values.items() if key.startswith(_CHECK)}
    return {name: "ok" if text.startswith(_OK) else text for name, text in items.items()}


def _links(values: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Each line by its name; a robot with one line has it under `link`, one with two has `link` for what joins them."""
    links: dict[str, dict[str, str]] = {}
    for key, text in values.items():
        found = _LINK.fullmatch(key)
        if key == "link":
            links.setdefault("link", {})["description"] = text
        elif found is not None:
            line, what = found.groups()
            if line is not None and line not in _LINES:  # a dotted count, such as refused.crc
                line, what = None, f"{line}.{what}"
            if (line or "link") in links or len(links) < _MOST_LINKS:
                links.setdefault(line or "link", {})[what] = text
    return links


def _beat(text: str) -> tuple[str, int]:
    station, _, stamp = text.rpartition(" ")
    return (station, int(stamp)) if station and len(stamp) < len(str(2**64)) and _is_digits(stamp) else ("", 0)


def _is_digits(text: str) -> bool:
    return text.isascii() and text.isdigit()


def _ns_of_ms(text: str) -> int:
    age = _number(text)
    return round(age * _NS_PER_MS) if age is not None and age > 0.0 else 0


def _number(text: str) -> float | None:
    try:
        return finite(float(text))
    except ValueError:
        return None

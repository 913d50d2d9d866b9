# SPDX-License-Identifier: MIT
"""When a redundant link passes from one line to the other, and how long that took."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.firmware_io.links.link import NowNs
from segway_ecc.firmware_io.links.redundant_link import RedundantLink

SWITCH_WITHIN_NS: Final = 60_000_000
"""While lines change, values may be this old: a robot with a fall time of 0.2 s has moved little."""
_KEPT: Final = 32


@dataclass(slots=True)
class Switch:
    """One change of lines.

    Attributes:
        last_good_ns: When the last good frame came on the line that was left.
        telemetry_gap_ns: From then to the first good frame on the other line; None until it came.
        torque_gap_ns: From then until the drives followed commands again; None until they did.
    """

    reason: str
    last_good_ns: int
    telemetry_gap_ns: int | None = None
    torque_gap_ns: int | None = None

    @property
    def gaps(self) -> Mapping[str, int | None]:
        """Both gaps by name."""
        return {"telemetry_gap": self.telemetry_gap_ns, "torque_gap": self.torque_gap_ns}


class Switching:
    """Judges the line in use, once a cycle.

    To the other line: as soon as the line in use reports that it is lost, cannot send, or some drive is unheard on it,
    if the other is good. Back to the bus: only while the robot is disarmed, once the bus has been good for a while.
    `switches` are the last changes, oldest first, `count` how many there were.
    """

    def __init__(self, link: RedundantLink, now_ns: NowNs) -> None:
        """Judge the lines of `link`."""
        self.link = link
        self.switches: deque[Switch] = deque(maxlen=_KEPT)
        self.count = 0
        self._now_ns = now_ns
        self._began_ns: int | None = None
        self._changed_ns: int | None = None
        self._bus_good_since_ns: int | None = None
        self._unmeasured: Switch | None = None

    @property
    def is_under_way(self) -> bool:
        """Whether a change began a moment ago and values may be a little old."""
        return self._changed_ns is not None and self._now_ns() - self._changed_ns <= SWITCH_WITHIN_NS

    @property
    def health(self) -> Mapping[str, str]:
        """The changes so far, as text."""
        health = {"link.switches": str(self.count)}
        if self.switches:
            last = self.switches[-1]
            health["link.last_switch"] = last.reason
            health |= {f"link.last_{name}_ms": _ms(gap) for name, gap in last.gaps.items() if gap is not None}
        return health

    def judge(self, received_ns: Sequence[int | None], *, is_armed: bool) -> str | None:
        """Look at the lines, and pass to the other one where it must be; what was done and why, None where nothing was.

        Args:
            received_ns: When the last intact frame of each drive was received; None for one that never was.
            is_armed: Whether the robot's motors are on, or are being switched on.
        """
        now_ns = self._now_ns()
        self._began_ns = self._began_ns or now_ns
        last_good_ns = min(self._began_ns if at_ns is None else at_ns for at_ns in received_ns)
        if not self.link.is_on_fallback or not self.link.standby_is_good:
            self._bus_good_since_ns = None
        elif self._bus_good_since_ns is None:
            self._bus_good_since_ns = now_ns
        reason = self._reason(now_ns, last_good_ns, is_armed=is_armed)
        if reason is None:
            return None
        left = self.link.owner_name
        self.link.pass_over()
        self._changed_ns = now_ns
        self.count += 1
        self._unmeasured = Switch(reason, last_good_ns)
        self.switches.append(self._unmeasured)
        return f"link: from {left} to {self.link.owner_name}: {reason}"

    def measure(self, received_ns: Sequence[int | None], *, is_ready: bool) -> Iterator[str]:
        """Complete the measurement of the last change, and report it; the drives follow commands where `is_ready`."""
        switch, now_ns = self._unmeasured, self._now_ns()
        if switch is None or self._changed_ns is None:
            return
        observed = [at_ns for at_ns in received_ns if at_ns is not None and at_ns >= self._changed_ns]
        if switch.telemetry_gap_ns is None and len(observed) == len(received_ns):
            switch.telemetry_gap_ns = max(observed) - switch.last_good_ns
            yield f"link: telemetry is back {_ms(switch.telemetry_gap_ns)} ms after the last good frame"
        if switch.torque_gap_ns is None and is_ready:
            switch.torque_gap_ns = now_ns - switch.last_good_ns
            yield f"link: the motors follow again {_ms(switch.torque_gap_ns)} ms after the last good frame"
        if None not in switch.gaps.values():
            self._unmeasured = None

    def _reason(self, now_ns: int, last_good_ns: int, *, is_armed: bool) -> str | None:
        dwell_ns = self.link.dwell_ns
        if not self.link.standby_is_good or (self._changed_ns is not None and now_ns - self._changed_ns < dwell_ns):
            return None
        if self.link.trouble is not None:
            return self.link.trouble
        if now_ns - last_good_ns > self.link.silence_ns:
            return f"no good frame for {_ms(now_ns - last_good_ns)} ms"
        since_ns = self._bus_good_since_ns
        if not is_armed and since_ns is not None and now_ns - since_ns >= dwell_ns:
            return "the bus is good again and the robot is disarmed"
        return None


def _ms(duration_ns: int) -> str:
    return f"{duration_ns * 1e-6:.1f}"

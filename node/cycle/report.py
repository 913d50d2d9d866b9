# SPDX-License-Identifier: MIT
"""The robot's diagnostics, gathered in pieces small enough for the slack of a cycle."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.setpoints import SetpointSchedule
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.cycle.timing import Histogram, LoopCounters, Summary, TimeBase
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.safety.deviations import CAUSES, UNITS
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.safety.residual import ResidualMonitor
from segway_ecc.node.safety.settings import SafetySettings

MODE_LEVELS: Final = {Mode.FAULT: Level.ERROR, Mode.HOLD: Level.WARN}
"""How bad a mode is; any other is fine."""

MODE_SUFFIX: Final = ": mode"
"""End of the name of the status of the mode; its values: `mode`, `reason`, `posture` where the robot has one, a
`check.<name>` per pre-arm check, and those of `TiltLimits` that the robot has."""
SETPOINTS_SUFFIX: Final = ": set-points"
_DONE: Final = object()
_LINK_STATE: Final = re.compile(r"link\.(\w+\.)?state")


class TiltLimits(NamedTuple):
    """How far the robot may lean, by its file.

    Attributes:
        tilt_limit_rad: Beyond that tilt from upright the torque is taken away at once, rad; None for any.
        down_rad: Beyond that tilt a robot that balances counts as fallen, after a while, rad; None without posture.
    """

    tilt_limit_rad: float | None = None
    down_rad: float | None = None

    def as_values(self) -> dict[str, str]:
        """Those that there are, by their names."""
        return {name: f"{limit:g}" for name, limit in zip(self._fields, self, strict=True) if limit is not None}


NO_TILT_LIMITS: Final = TiltLimits()


def tilt_limits_of(safety: SafetySettings | None) -> TiltLimits:
    """The limits that a robot file has."""
    if safety is None:
        return NO_TILT_LIMITS
    return TiltLimits(safety.tilt_limit_rad, None if safety.posture is None else safety.posture.down_rad)


def state_text(mode: str, posture: str | None) -> str:
    """The mode, and beside it the posture of a robot that has one; empty is none."""
    return f"{mode}, {posture}" if posture else str(mode)


class Observed(Protocol):
    """What the report reads of a cycle."""

    arming: ArmingManager
    schedule: SetpointSchedule
    time_base: TimeBase
    hardware: Hardware
    sensors: Sensors | None
    writer: VariableWriter

    @property
    def posture(self) -> Posture | None:
        """What the robot is doing; None where it has no posture."""

    @property
    def residual(self) -> ResidualMonitor | None:
        """What compares the robot's acceleration with what was designed; None where nothing does."""

    @property
    def histograms(self) -> dict[str, Histogram]:
        """How late each cycle started, and the durations of its phases and of the whole of it, by name."""


class DiagnosticReport:
    """Gathers one histogram per call of `work`, then one status; `statuses` is the newest complete set."""

    def __init__(
        self,
        cycle: Observed,
        counters: LoopCounters,
        period_ns: int,
        robot_name: str,
        tilt_limits: TiltLimits = NO_TILT_LIMITS,
    ) -> None:
        self.statuses: Sequence[DiagnosticStatus] = ()
        self._cycle = cycle
        self._counters = counters
        self._wanted_hz = 1e9 / period_ns
        self._robot_name = robot_name
        self._tilt_limits = tilt_limits.as_values()
        self._summaries: dict[str, Summary] = {}
        self._work: Iterator[None] | None = None
        self._old_counts: dict[str, int] = {}

    def begin(self) -> None:
        """Start a new set; one that is not complete is completed first."""
        self._work = self._work or self._pieces()

    @property
    def is_pending(self) -> bool:
        """Whether the set that was begun is not complete."""
        return self._work is not None

    def work(self) -> bool:
        """Do one piece of the set that was begun; True when that completed it."""
        if self._work is not None and next(self._work, _DONE) is _DONE:
            self._work = None
        return self._work is None

    def _pieces(self) -> Iterator[None]:
        for name, histogram in self._cycle.histograms.items():
            self._summaries[name] = histogram.summary()
            yield
        arming = self._cycle.arming
        modes = arming.modes
        posture = self._cycle.posture
        values = {"mode": str(modes.mode), "reason": modes.reason}
        values |= {} if posture is None else {"posture": str(posture)}
        values |= {f"check.{check.name}": str(check) for check in arming.checklist()}
        values |= self._tilt_limits
        level, message = MODE_LEVELS.get(modes.mode, Level.OK), f"{state_text(modes.mode, posture)}: {modes.reason}"
        mode = DiagnosticStatus(level, f"{self._robot_name}{MODE_SUFFIX}", message, values)
        yield
        timing = self._timing()
        yield
        setpoints = self._setpoints()
        yield
        self.statuses = mode, timing, setpoints, self._hardware(), *self._residual()

    def _residual(self) -> Iterator[DiagnosticStatus]:
        """What differs from the design, of a robot where that is watched."""
        residual = self._cycle.residual
        if residual is None:
            return
        estimates = dict(zip(CAUSES, zip(residual.estimates, UNITS, strict=True), strict=True))
        values = {cause: f"{value:+.4g} {unit}" for cause, (value, unit) in estimates.items()}
        beyond = [cause for cause, warned in zip(CAUSES, residual.deviations.warned, strict=True) if warned]
        trouble = ", ".join(f"{cause} {values[cause]}" for cause in beyond)
        values["residual"] = f"{residual.residual:+.3g} N"
        yield self._status("residual", trouble and f"not as designed: {trouble}", "as designed", values)

    def _timing(self) -> DiagnosticStatus:
        counters = self._counters
        missed = self._new("deadlines", counters.late + counters.skipped)
        values = {
            "rate_hz": f"{counters.mean_rate_hz:.4f}",
            "wanted_rate_hz": f"{self._wanted_hz:g}",
            "cycles": str(counters.cycles),
            "late": str(counters.late),
            "overrun": str(counters.overrun),
            "skipped": str(counters.skipped),
            "time_base_realigned": str(self._cycle.time_base.realigned),
            **{name: summary.as_text() for name, summary in self._summaries.items()},
        }
        trouble = f"{missed} late or skipped since the last report" if missed else ""
        return self._status("timing", trouble, f"{counters.mean_rate_hz:.2f} Hz", values)

    def _setpoints(self) -> DiagnosticStatus:
        schedule = self._cycle.schedule
        writer = self._cycle.writer
        refused = self._new("setpoints", sum(schedule.refused.values()))
        clamped, writes = self._new("clamped", schedule.clamped), self._new("writes", writer.refused)
        values = {
            "applied": str(schedule.applied),
            "late": str(schedule.late),
            **({"clamped": str(schedule.clamped)} if schedule.clamped else {}),
            **{f"refused.{cause}": str(count) for cause, count in schedule.refused.items()},
            "parameters.written": str(writer.written),
            "parameters.refused": str(writer.refused),
        }
        trouble = "; ".join(
            f"{count} {what} since the last report"
            for count, what in (
                (refused, "refused"),
                (clamped, "clamped to the limits"),
                (writes, "writes of parameters refused"),
            )
            if count
        )
        return self._status("set-points", trouble, "taken as they come", values)

    def _hardware(self) -> DiagnosticStatus:
        health: Mapping[str, str] = self._cycle.hardware.health
        if not health:
            return self._status("hardware", "", "none: the robot is all model", {})
        refused = self._new("frames", sum(int(v) for k, v in health.items() if "refused." in k))
        gaps = self._new("gaps", sum(int(v) for k, v in health.items() if k.endswith(".gaps")))
        states = {name: health[name] for name in health if _LINK_STATE.fullmatch(name) and health[name] != "active"}
        trouble = [f"{name}: {state}" for name, state in states.items()]
        trouble += [f"{refused} frames refused since the last report"] if refused else []
        trouble += [f"{gaps} gaps in telemetry since the last report"] if gaps else []
        trouble += ["the guard of this bus is lost"] if health.get("guard") == "lost" else []
        sensors = self._cycle.sensors
        ages = zip(self._cycle.hardware.signals, sensors.ages if sensors else (), strict=False)
        values = {**health, **{f"age.{name}": f"{age * 1e3:.1f} ms" for name, age in ages}}
        return self._status("hardware", "; ".join(trouble), health.get("link", ""), values)

    def _status(self, part: str, trouble: str, fine: str, values: Mapping[str, str]) -> DiagnosticStatus:
        level = Level.WARN if trouble else Level.OK
        return DiagnosticStatus(level, f"{self._robot_name}: {part}", trouble or fine, values)

    def _new(self, what: str, count: int) -> int:
        old = self._old_counts.get(what, 0)
        self._old_counts[what] = count
        return count - old

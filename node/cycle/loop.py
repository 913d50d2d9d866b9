# SPDX-License-Identifier: MIT
"""The loop: one thread that waits for nothing but its next deadline, and what people read while it runs."""

import contextlib
import gc
import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import Final

from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.node.cycle.cycle import Cycle
from segway_ecc.node.cycle.interfaces import Stage
from segway_ecc.node.cycle.report import NO_TILT_LIMITS, DiagnosticReport, TiltLimits, state_text
from segway_ecc.node.cycle.service import NotifySocket, Service
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.cycle.timing import LoopCounters, Summary
from segway_ecc.node.safety.modes import Mode, Modes
from segway_ecc.node.safety.posture import Posture

_LATE_FRACTION: Final = 0.1
_SLACK_FRACTION: Final = 0.25
_DIAGNOSTICS_PERIOD_S: Final = 1.0
_STATES_MEASURED: Final = 3
_logger = logging.getLogger(__name__)


class StateLog:
    """Logs the newest mode or refusal to arm where it has changed, at most once a second: no flicker floods the log."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._logged: tuple[Mode, Posture | None, bool, str] | None = None
        self._logged_ns: int | None = None

    def log_state(self, modes: Modes, arming_refusal: str | None, posture: Posture | None = None) -> None:
        """Log the mode and the posture with the reason, or why the robot that arms itself cannot arm."""
        can_arm = arming_refusal is None
        new = modes.mode, posture, can_arm, modes.reason if arming_refusal is None else arming_refusal
        if new == self._logged:
            return
        now_ns = self._clock.now_ns()
        if self._logged_ns is not None and now_ns - self._logged_ns < NS_PER_S:
            return
        self._logged, self._logged_ns = new, now_ns
        text = "%s: %s" if can_arm else "%s, cannot arm: %s"
        _logger.info(text, state_text(modes.mode, posture), new[-1])

    def log_event(self, events: deque[str]) -> None:
        """Log the oldest event, if there is any."""
        if events:
            _logger.warning(events.popleft())

    def log_events(self, events: deque[str]) -> None:
        """Log all events, the oldest first."""
        while events:
            self.log_event(events)


class Loop:
    """Runs a cycle at absolute deadlines until it is asked to stop, and always leaves the motors off.

    A cycle that starts late is counted. Where whole periods were lost they are skipped and counted, never made up for:
    at most one cycle runs per period.

    Attributes:
        counters: How the deadlines were met.
        stop_reason: Why the loop ended, once it has.
        sits_down_first: Whether a robot that balances is to sit down before the loop ends.
        service: Reports readiness and the watchdog's keep-alive to the service manager; at first to nobody.
    """

    def __init__(  # noqa: PLR0913 - what a loop is made of, once
        self,
        *,
        cycle: Cycle,
        clock: Clock,
        stage: Stage,
        period_ns: int,
        robot_name: str,
        tilt_limits: TiltLimits = NO_TILT_LIMITS,
    ) -> None:
        self.counters = LoopCounters()
        self.stop_reason: str | None = None
        self.sits_down_first = False
        self.service = Service(NotifySocket(""), period_ns)
        self._ends_at_once = self._is_sitting_down = False
        self._cycle = cycle
        self._clock = clock
        self._stage = stage
        self._recorder = cycle.recorder
        self._period_ns = period_ns
        self._robot_name = robot_name
        self._late_ns = round(_LATE_FRACTION * period_ns)
        self._slack_ns = round(_SLACK_FRACTION * period_ns)
        self._diagnostics = DiagnosticReport(cycle, self.counters, period_ns, robot_name, tilt_limits)
        self._deliveries: deque[Callable[[], None]] = deque()
        self._collect_due = self._state_due = False
        self._state_ns = 0
        self._state_log = StateLog(clock)
        self._diagnostics_every = max(round(_DIAGNOSTICS_PERIOD_S * NS_PER_S / period_ns), 1)

    def stop(self, reason: str) -> None:
        """Ask the loop to end after the present cycle, sitting down first; asked again, it ends at once.

        May be called from a signal handler.
        """
        self._ends_at_once = self.stop_reason is not None
        self.stop_reason = self.stop_reason or reason

    @property
    def modes(self) -> Modes:
        """What the robot is allowed to do, and why."""
        return self._cycle.arming.modes

    @property
    def arming_refusal(self) -> str | None:
        """What keeps a robot that arms itself from doing so; None where nothing does."""
        return self._cycle.arming.arming_refusal

    def timing(self) -> dict[str, Summary]:
        """Lateness, and the duration of the cycle and its phases, by name."""
        return {name: histogram.summary() for name, histogram in self._cycle.histograms.items()}

    def statuses(self) -> Sequence[DiagnosticStatus]:
        """The robot's diagnostics as of now; takes too long for the loop itself."""
        self._diagnostics.begin()
        while self._diagnostics.is_pending:
            self._diagnostics.work()
        return self._diagnostics.statuses

    def run(self, cycles: int | None = None) -> None:
        """Run until stopped, or for a number of cycles.

        Raises:
            HardwareError: The hardware could not be opened.
            ModelFailedError: The model failed; the robot went to FAULT, and its motors are off already.
        """
        with contextlib.ExitStack() as exits:
            # Left in reverse: zero first, then the final equations, then everything is closed.
            exits.callback(self._state_log.log_events, self._cycle.events)
            exits.callback(self._recorder.close)
            exits.callback(self._stage.close)
            exits.callback(self._cycle.hardware.close)
            exits.callback(self._cycle.terminate)
            self._cycle.start()
            link = self._cycle.hardware.health.get("link")
            where = f" on {link}" if link else ""
            _logger.info("robot '%s'%s runs at %g Hz", self._robot_name, where, NS_PER_S / self._period_ns)
            exits.callback(self.service.stopping)
            exits.callback(self._cycle.disarm)
            with _garbage_collected_in_the_slack():
                self._run(cycles)

    def _run(self, cycles: int | None) -> None:
        clock, counters, period_ns = self._clock, self.counters, self._period_ns
        self._state_ns = self._shortest_state_ns()
        deadline_ns = clock.now_ns() + period_ns
        self._cycle.time_base.anchor(counters.cycles, self._wall_at(deadline_ns)[0])
        while not self._is_over():
            clock.sleep_until_ns(deadline_ns)
            lateness_ns = clock.now_ns() - deadline_ns
            counters.last_ns = deadline_ns + lateness_ns
            counters.started_ns = counters.started_ns or counters.last_ns
            counters.late += lateness_ns > self._late_ns
            if self._cycle.is_idle(counters.cycles):
                wall_ns, uncertain_ns = self._wall_at(deadline_ns)
                if uncertain_ns < self._late_ns:
                    self._cycle.time_base.follow(counters.cycles, wall_ns)
            self._cycle.run(counters.cycles, lateness_ns)
            counters.cycles += 1
            if counters.cycles == cycles:
                self._end(f"{cycles} cycles were asked for")
            if self._stage.over is not None:
                self._end(self._stage.over)
            if self._cycle.model_stopped:
                self._end("the model asked to stop")
                self._ends_at_once = True
            deadline_ns += period_ns
            deadline_ns += self._lost_ns(deadline_ns)
            self.service.look(lateness_ns, counters.skipped)
            self._use_slack(deadline_ns)

    def _end(self, reason: str) -> None:
        self.stop_reason = self.stop_reason or reason

    def _is_over(self) -> bool:
        """Whether the loop ends now: it was asked to, and the robot sits, where it is to."""
        if self.stop_reason is None:
            return False
        if self._ends_at_once or not self.sits_down_first or not self._cycle.sit_down_first():
            return True
        if not self._is_sitting_down:
            self._is_sitting_down = True
            self._cycle.events.append(f"{self.stop_reason}: the robot sits down first; asked again, it ends at once")
        return False

    def _wall_at(self, deadline_ns: int) -> tuple[int, int]:
        """The wall clock at a deadline, and how uncertain it is, both ns."""
        before_ns = self._clock.now_ns()
        wall_ns = self._clock.wall_ns()
        return wall_ns - (before_ns - deadline_ns), self._clock.now_ns() - before_ns

    def _lost_ns(self, deadline_ns: int) -> int:
        """Whole periods that have passed since the next deadline, which are skipped."""
        over_ns = self._clock.now_ns() - deadline_ns
        if over_ns <= 0:
            return 0
        self.counters.overrun += 1
        # A cycle that started whole periods late has had the period in which it started.
        lateness_ns = self.counters.last_ns - (deadline_ns - self._period_ns)
        lost = max(over_ns, lateness_ns) // self._period_ns
        self.counters.skipped += lost
        return lost * self._period_ns

    def _use_slack(self, deadline_ns: int) -> None:
        """Slow work in small pieces while there is time; one even where there is none, so that a busy robot reports."""
        arming = self._cycle.arming
        self._state_log.log_state(arming.modes, arming.arming_refusal, self._cycle.posture)
        self._state_log.log_event(self._cycle.events)
        if self.counters.cycles % self._diagnostics_every == 0:
            self._diagnostics.begin()
            self._collect_due = self._state_due = True
        if self._state_due and self._has_slack(deadline_ns, self._state_ns):
            # First: what comes later in the slack may write to the model. Where it never fits there is none.
            self._state_due = False
            self._recorder.write_state(partial(self._cycle.take_state, self.counters.cycles))
        if self._do_piece():
            while self._has_slack(deadline_ns) and self._do_piece():
                pass
        if self._has_slack(deadline_ns):
            self._stage.do_background_work()

    def _has_slack(self, deadline_ns: int, needed_ns: int = 0) -> bool:
        return deadline_ns - self._clock.now_ns() > self._slack_ns + needed_ns

    def _shortest_state_ns(self) -> int:
        """How long a snapshot takes; the first also finds out what there is to take."""
        stamps = []
        for _ in range(_STATES_MEASURED):
            stamps.append(self._clock.now_ns())
            self._cycle.take_state(0)
        return min(after - before for before, after in pairwise((*stamps, self._clock.now_ns())))

    def _do_piece(self) -> bool:
        """Do one piece of this second's work; False when it is done."""
        if self._diagnostics.is_pending:
            if self._diagnostics.work():  # complete: delivered to everybody, one after the other
                stamp_ns, statuses = self._cycle.time_base.stamp_ns(self.counters.cycles), self._diagnostics.statuses
                self._deliveries.append(partial(self.service.report, statuses, self.counters))
                self._deliveries.append(partial(self._stage.publish_diagnostics, stamp_ns, statuses))
                self._deliveries.append(partial(self._recorder.write_diagnostics, stamp_ns, statuses))
            return True
        if self._deliveries:
            self._deliveries.popleft()()
            return True
        collected, self._collect_due = self._collect_due, False
        if collected:
            gc.collect(1)
        return collected


@contextlib.contextmanager
def _garbage_collected_in_the_slack() -> Iterator[None]:
    """Collect what is young, leave what survives alone for good, and collect by hand from then on."""
    gc.collect(1)  # what is older was looked at before, and all of it takes longer than a hundred cycles
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()

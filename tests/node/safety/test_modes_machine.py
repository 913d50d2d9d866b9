# SPDX-License-Identifier: MIT
"""Whatever is asked and observed in whatever order: the mode, its reason and every transition are as they should be."""

from collections.abc import Sequence

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from segway_ecc.node.safety.modes import ACTIVE, Action, Mode, Modes, Transition

KEPT = 64
FAULTS = st.lists(st.sampled_from(["too hot", "too fast"]), max_size=2, unique=True)
OBSTACLES = st.lists(st.sampled_from(["no supply", "no watchdog"]), max_size=2, unique=True)


class Operation(RuleBasedStateMachine):
    """The modes, and an account of them: is there a fault, is it armed, are set-points or the station silent."""

    def __init__(self) -> None:
        super().__init__()
        self.modes = Modes()
        self.fault: str | None = None  # the first since the last clear
        self.armed = False
        self.silent = self.lost = False
        self.mode, self.reason = Mode.DISARMED, "just started"
        self.told: list[Transition] = []

    def follow(self, reason: str) -> None:
        """Account for what has happened."""
        awake = Mode.HOLD if self.silent or self.lost else Mode.ARMED
        mode = Mode.FAULT if self.fault else awake if self.armed else Mode.DISARMED
        if (mode, reason) != (self.mode, self.reason):
            self.told.append(Transition(self.modes.cycle, mode, reason))
        self.mode, self.reason = mode, reason

    def break_down(self, reason: str) -> None:
        self.fault, self.armed = reason, False
        self.follow(reason)

    @rule(cycles=st.integers(1, 100))
    def time_passes(self, cycles: int) -> None:
        self.modes.cycle += cycles

    @rule(obstacles=OBSTACLES)
    def arm(self, obstacles: Sequence[str]) -> None:
        answer = self.modes.ask(Action.ARM, obstacles)
        if self.armed:
            assert answer.accepted
        elif self.fault or obstacles:
            assert not answer.accepted
            assert (self.fault or "; ".join(obstacles)) in answer.message
        else:
            assert answer.accepted
            self.armed, self.silent, self.lost = True, False, False
            self.follow("asked to arm")

    @rule()
    def disarm(self) -> None:
        assert self.modes.ask(Action.DISARM).accepted
        self.armed = False
        if not self.fault:
            self.follow("asked to disarm")

    @rule()
    def stop(self) -> None:
        assert self.modes.ask(Action.STOP).accepted
        self.break_down("stop was pressed")

    @rule()
    def clear_fault(self) -> None:
        assert self.modes.ask(Action.CLEAR_FAULT).accepted == bool(self.fault)
        if self.fault:
            self.fault = None
            self.follow("fault cleared")

    @rule(reason=st.sampled_from(["the bus is gone", "the model failed"]))
    def fail(self, reason: str) -> None:
        self.modes.fail(reason)
        if not self.fault:
            self.break_down(reason)

    @rule(reason=st.sampled_from(["the base station is lost", "it is late"]))
    def disarm_itself(self, reason: str) -> None:
        self.modes.disarm(reason)
        if self.armed:
            self.armed = False
            self.follow(reason)

    @rule(faults=FAULTS, silent=st.booleans(), lost=st.booleans())
    def observe(self, faults: Sequence[str], *, silent: bool, lost: bool) -> None:
        self.modes.observe(faults, setpoints_silent=silent, station_lost=lost)
        if self.armed and faults:
            self.break_down("; ".join(faults))
        elif self.armed:
            before = (self.silent and not self.lost, self.lost)
            self.silent, self.lost = silent, lost
            if lost and not before[1]:
                self.follow("the base station is lost")
            elif not lost and silent and not before[0]:
                self.follow("no set-point arrives any more")
            elif not (lost or silent) and any(before):
                self.follow("the base station is back" if before[1] else "set-points arrive again")

    @invariant()
    def the_mode_and_its_reason_are_as_accounted(self) -> None:
        assert (self.modes.mode, self.modes.reason) == (self.mode, self.reason)

    @invariant()
    def it_is_active_only_while_armed_and_in_fault_until_cleared(self) -> None:
        assert (self.modes.mode in ACTIVE) == self.armed
        assert (self.modes.mode is Mode.FAULT) == bool(self.fault)

    @invariant()
    def every_transition_is_kept_with_its_reason(self) -> None:
        assert list(self.modes.history) == self.told[-KEPT:]


Operation.TestCase.settings = settings(derandomize=True, deadline=None, max_examples=60, stateful_step_count=50)
TestOperation = Operation.TestCase

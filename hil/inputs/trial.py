# SPDX-License-Identifier: MIT
"""One input to a robot that runs, its outcome, and whether that is the declared one."""

import contextlib
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from typing import Final

from segway_ecc.hil.drill.parts import new_lines
from segway_ecc.hil.drill.plant_control import Torque
from segway_ecc.hil.drill.trial import GAP_LIMIT_S, LIMIT_S
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.inputs.rig import Arrangement, Rig, State
from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.node.cycle.report import state_text
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

_SETTLES_WITHIN_S: Final = 10.0
_SITS_WITHIN_S: Final = 6.0
"""`safety.posture.sit_down_s`, and a second in which it is not looked at."""
_SITS_FOR_S: Final = 0.3
"""It takes about a second; one that is dropped has no torque from the first cycle on."""
_POLL_S: Final = 0.1
_STARTS: Final = 3
"""A machine that stalls while a robot stands up drops it before it is given anything."""
_SHOWN: Final = 400
"""Characters of a reason."""


@dataclass(frozen=True, slots=True)
class Event:
    """What was done.

    Attributes:
        at_ns: When, monotonic, ns.
        answers: What was answered, by whoever was asked.
        exit_code: Of the command that was refused, where there was one.
        wrong: What was not as declared in the answers.
    """

    at_ns: int
    answers: Sequence[str] = ()
    exit_code: int | None = None
    wrong: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Declared:
    """The outcome that an input must have.

    Attributes:
        mode: The robot's mode afterwards; empty where `run` ends, or nothing runs.
        reason: A pattern of the reason, which must stand in an answer or a message.
        zero_within_s: Longest time to the last torque at the drives, s; None where torque goes on.
        exit_code: Of `run`, or of the command that the trial is about; None where there is none.
        posture: The robot's posture afterwards; empty where it does not matter.
        zero_after_s: Shortest time to the last torque, s: of a robot that sits down instead of falling.
    """

    mode: str
    reason: str
    zero_within_s: float | None = LIMIT_S
    exit_code: int | None = None
    posture: str = ""
    zero_after_s: float = 0.0

    @property
    def goes_on(self) -> bool:
        """Whether the robot is driven afterwards as before."""
        return self.zero_within_s is None

    @property
    def text(self) -> str:
        """The outcome."""
        return outcome_text(State(self.mode, self.posture, ""), self.exit_code)


def balances(reason: str, exit_code: int | None = None) -> Declared:
    """It goes on as before; `exit_code` is that of a command that is refused."""
    return Declared(Mode.ARMED, reason, None, exit_code, Posture.BALANCING)


def falls(reason: str, zero_within_s: float = LIMIT_S) -> Declared:
    """Its torque is taken away, and it falls."""
    return Declared(Mode.FAULT, reason, zero_within_s, posture=Posture.FALLEN)


def rests(reason: str) -> Declared:
    """It rests, disarmed, as before."""
    return Declared(Mode.DISARMED, reason, 0.0, posture=Posture.RESTING)


def sits_down(reason: str) -> Declared:
    """It sits down under control, and then `run` ends."""
    return Declared("", reason, _SITS_WITHIN_S, 0, zero_after_s=_SITS_FOR_S)


def ends(reason: str, exit_code: int, zero_within_s: float = LIMIT_S) -> Declared:
    """`run` ends."""
    return Declared("", reason, zero_within_s, exit_code)


Do = Callable[[Rig, ExitStack], Event]
"""Gives the input. What must be undone goes onto the stack."""


@dataclass(frozen=True, slots=True)
class InputTrial:
    """One input.

    Attributes:
        item: Which kind of input.
        look_s: How long to look on for at least, s.
        follows: Whether it needs the robot as the trial before left it.
        needs: Why it cannot be tried here; empty where it can.
    """

    item: int
    name: str
    do: Do
    declared: Declared
    arrangement: Arrangement = field(default_factory=Arrangement)
    look_s: float = 1.0
    follows: bool = False
    needs: Callable[[], str] = lambda: ""


@dataclass(frozen=True, slots=True)
class InputResult:
    """What came of an input.

    Attributes:
        outcome: The robot's mode, and the exit code where something ended.
        torque: What became of the torque; None where nothing ran.
        wrong: What was not as declared.
        not_run: Why it was not tried; empty where it was.
        stall: How the machine stalled meanwhile; empty where it did not.
    """

    item: int
    name: str
    declared: str
    outcome: str = ""
    reason: str = ""
    torque: Torque | None = None
    limit_s: float | None = None
    wrong: tuple[str, ...] = ()
    not_run: str = ""
    stall: str = ""

    @property
    def is_as_declared(self) -> bool:
        """Whether it was tried, and nothing was otherwise."""
        return not self.wrong and not self.not_run


def outcome_text(state: State, exit_code: int | None) -> str:
    """An outcome in short."""
    words = state_text(state.mode, state.posture), "" if exit_code is None else f"exit {exit_code}"
    return "; ".join(filter(None, words))


def run_all(
    trials: Sequence[InputTrial], start: Callable[[Arrangement], AbstractContextManager[Rig]]
) -> Iterator[InputResult]:
    """Try one after the other, each result as soon as it is there.

    A robot that goes on as declared is there for the next one too, where that needs the same; else each has its own.
    """
    with ExitStack() as stack:
        rig: Rig | None = None
        goes_on = False
        for trial in trials:
            lacks = trial.needs()
            if lacks:
                yield InputResult(trial.item, trial.name, trial.declared.text, not_run=lacks)
                continue
            if rig is not None and not trial.follows and not (goes_on and rig.arrangement == trial.arrangement):
                stack.close()
                rig = None
            try:
                if rig is None and trial.follows:
                    raise RigError("the trial before it failed")  # noqa: TRY301 - it is one result of several
                rig = rig or _started(trial, start, stack)
                result = _try(trial, rig)
            except RigError as error:
                result = InputResult(trial.item, trial.name, trial.declared.text, wrong=(f"failed: {error}",))
            goes_on = trial.declared.goes_on
            if not result.is_as_declared:
                stack.close()
                rig = None
            yield result


def _started(trial: InputTrial, start: Callable[[Arrangement], AbstractContextManager[Rig]], stack: ExitStack) -> Rig:
    """A robot that is ready for its input; what keeps one from that was not the input, and is reported."""
    for left in reversed(range(_STARTS)):
        try:
            return stack.enter_context(start(trial.arrangement))
        except ProcessFailedError as error:
            if not left:
                raise
            sys.stderr.write(f"segway-ecc: {trial.item}: {trial.name}: starting another robot: {error}\n")
    raise AssertionError


def _try(trial: InputTrial, rig: Rig) -> InputResult:
    declared, before = trial.declared, rig.lines
    with contextlib.ExitStack() as undo:
        event = trial.do(rig, undo)
        time.sleep(trial.look_s)
        deadline = time.monotonic() + _SETTLES_WITHIN_S
        while _otherwise(declared, rig, event) or _reason(declared, rig, event, before) is None:
            if time.monotonic() > deadline:
                break
            time.sleep(_POLL_S)
    torque, found = rig.torque(event.at_ns), _reason(declared, rig, event, before)
    wrong = [*_otherwise(declared, rig, event), *_torque_differences(declared, torque)]
    if found is None:
        wrong.append(f"no reason like '{declared.reason}'")
        found = " | ".join([*event.answers, *new_lines(before, rig.lines)][-3:])
    return InputResult(
        trial.item,
        trial.name,
        declared.text,
        outcome_text(*_outcome(rig, event)),
        found if len(found) <= _SHOWN else f"{found[:_SHOWN]}...",
        torque,
        declared.zero_within_s,
        tuple(wrong),
    )


def _reason(declared: Declared, rig: Rig, event: Event, before: Sequence[str]) -> str | None:
    texts = [*event.answers, *new_lines(before, rig.lines)]
    return next((text for text in texts if re.search(declared.reason, text)), None)


def _outcome(rig: Rig, event: Event) -> tuple[State, int | None]:
    ended = rig.exit_code
    state = rig.state if ended is None else State("", "", "run has ended")
    return state, ended if event.exit_code is None else event.exit_code


def _otherwise(declared: Declared, rig: Rig, event: Event) -> list[str]:
    return [*event.wrong, *_differences(declared, *_outcome(rig, event))]


def _differences(declared: Declared, state: State, exit_code: int | None) -> Iterator[str]:
    if state.mode != declared.mode:
        yield f"mode {state.mode or 'none'} ({state.reason}), not {declared.mode or 'none'}"
    if declared.posture and state.posture != declared.posture:
        yield f"posture {state.posture or 'none'}, not {declared.posture}"
    if exit_code != declared.exit_code:
        yield f"exit code {exit_code}, not {declared.exit_code}".replace("None", "none")


def _torque_differences(declared: Declared, torque: Torque) -> Iterator[str]:
    limit_s = declared.zero_within_s
    if limit_s is None:
        if torque.zero_s is not None:
            yield f"torque ended after {torque.last_s * 1e3:.1f} ms"
        elif torque.gap_s > GAP_LIMIT_S:
            yield f"no torque for {torque.gap_s * 1e3:.1f} ms"
    elif torque.zero_s is None:
        yield "torque goes on"
    elif torque.last_s > limit_s:
        yield f"torque for {torque.last_s * 1e3:.1f} ms, not {limit_s * 1e3:g} ms at the most"
    elif torque.last_s < declared.zero_after_s:
        yield f"torque for {torque.last_s * 1e3:.1f} ms, not {declared.zero_after_s * 1e3:g} ms at the least"

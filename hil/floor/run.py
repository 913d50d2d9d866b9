# SPDX-License-Identifier: MIT
"""One trial on a floor with all of safety on, and how it ended; and many, side by side."""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

import msgspec

from segway_ecc.hil.design.balance import Balance
from segway_ecc.hil.floor.contact import on_floor
from segway_ecc.hil.floor.trials import UP_S, FloorTrial, TrialKind
from segway_ecc.hil.processes import quiet, results_of
from segway_ecc.hil.progress import OnProgress
from segway_ecc.node.config import load_robot
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

_UPRIGHT_RAD: Final = 0.1
_FALLS_S: Final = 1.0
"""A robot that falls as a trial ends is seen to end safe within that time, or not to, s."""
_OFF: Final = frozenset({Mode.FAULT, Mode.DISARMED})
_CHUNK: Final = 1


class Ending(StrEnum):
    """How a trial ended.

    Attributes:
        STANDS: Balancing, and upright by the plant's truth.
        SAFE: In FAULT, or DISARMED, with a reason and without torque.
        BROKEN: Anything else: it lies and drives on, sends torque in FAULT, has no reason, or does not get up.
    """

    STANDS = "stands"
    SAFE = "ends safe"
    BROKEN = "BROKEN"


class FloorRun(NamedTuple):
    """A trial to be made."""

    robot: str
    trial: FloorTrial
    seed: int


class FloorResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came of it.

    Attributes:
        reason: That the robot gave; for BROKEN, what is wrong. Empty where it stands.
        way_m: How far along x it got from where it lay, either way, while it was armed.
        ended_s: When it was in FAULT; None where it was not.
    """

    robot: str
    trial: str
    kind: TrialKind
    seed: int
    ending: Ending
    reason: str
    way_m: float
    ended_s: float | None


@quiet("segway_ecc.node")
def run_floor_trial(run: FloorRun) -> FloorResult:
    """Make a trial in lock step.

    Raises:
        NoSimulationError: There is no plant with friction for this robot, or MuJoCo is not installed.
    """
    trial, balance = run.trial, _made(run, 0.0)
    ending, reason = judge(balance)
    if ending is Ending.BROKEN:
        balance = _made(run, _FALLS_S)
        ending, reason = judge(balance)
    period_s = balance.robot.period_ns * 1e-9
    faults = [place for place, mode in enumerate(balance.modes) if mode is Mode.FAULT]
    armed_s = (faults[0] if faults else len(balance.modes)) * period_s
    return FloorResult(
        robot=run.robot,
        trial=trial.name,
        kind=trial.kind,
        seed=run.seed,
        ending=ending,
        reason=reason,
        way_m=max((abs(at.x) for at in balance.truth if at.time <= armed_s), default=0.0),
        ended_s=armed_s if faults else None,
    )


def _made(run: FloorRun, more_s: float) -> Balance:
    """The robot once the trial is over, and so much later, s."""
    trial = run.trial
    balance = Balance(on_floor(load_robot(run.robot)), pitch=trial.pitch, seed=run.seed, plant=trial.plant)
    balance.run(trial.duration_s + more_s, _script(trial))
    return balance


def judge(balance: Balance) -> tuple[Ending, str]:
    """How a robot that has run ended, and why."""
    mode, posture, lean = balance.modes[-1], balance.postures[-1], balance.truth[-1].pitch
    reason = balance.loop.arming_refusal if Mode.ARMED not in balance.modes else balance.loop.modes.reason
    if driven := [at for at, sent in zip(balance.modes, balance.commands, strict=True) if at in _OFF and any(sent)]:
        return Ending.BROKEN, f"sends torque in {driven[0].name}, {len(driven)} times"
    if mode in _OFF:
        return (Ending.SAFE, reason) if reason else (Ending.BROKEN, f"is in {mode.name} and gives no reason")
    if mode is Mode.ARMED and posture is Posture.BALANCING and abs(lean) < _UPRIGHT_RAD:
        return Ending.STANDS, ""
    doing = "has no posture" if posture is None else f"is {posture}"
    return Ending.BROKEN, f"is in {mode.name}, {doing}, and leans by {lean:.2f} rad"


def run_floor_trials(runs: Sequence[FloorRun], jobs: int, on_progress: OnProgress) -> list[FloorResult]:
    """Make trials in so many processes; the results are in their order, whatever `jobs` is."""
    results: list[FloorResult] = []
    with results_of(run_floor_trial, runs, jobs, _CHUNK) as finished:
        for result in finished:
            results.append(result)
            on_progress(len(results), len(runs))
    return results


def _script(trial: FloorTrial) -> Mapping[float, Callable[[Balance], None]]:
    """What happens to it once it stands."""
    if trial.push:
        return {
            UP_S: lambda balance: balance.plant.write("PushForce", trial.push),
            UP_S + trial.push_s: lambda balance: balance.plant.write("PushForce", 0.0),
        }
    return {UP_S: lambda balance: balance.drive(trial.speed, 0.0)} if trial.speed else {}

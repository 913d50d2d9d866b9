# SPDX-License-Identifier: MIT
"""The residual monitor in a robot that balances: what it warns of, that it is in the log, and that a replay has it."""

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import pytest

from segway_ecc.hil.design.balance import Balance, ScriptedStage
from segway_ecc.node.config import load_robot
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.replay.replay import replay
from segway_ecc.node.safety.deviations import CAUSES
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.residual import ResidualMonitor

_DURATION_S: Final = {True: 24.0, False: 16.0}
"""With a script, and without."""
Script = Mapping[float, Callable[[Balance], None]]


def driving(linear: float, angular: float) -> Callable[[Balance], None]:
    return lambda balance: balance.drive(linear, angular)


def pushing(force: float) -> Callable[[Balance], None]:
    return lambda balance: balance.plant.write("PushForce", force)


DRIVES: Final = {
    4.0: driving(0.5, 0.0),
    7.0: driving(0.5, 0.8),
    9.0: driving(0.0, 0.0),
    11.0: driving(-0.4, 0.0),
    14.0: driving(0.0, 0.0),
    16.0: driving(0.8, 0.0),
    19.0: driving(0.0, 0.8),
    22.0: driving(0.0, 0.0),
}
PUSHES: Final = {
    4.0: pushing(20.0),
    4.1: pushing(0.0),
    8.0: pushing(-30.0),
    8.1: pushing(0.0),
    12.0: pushing(6.0),
    13.0: pushing(0.0),
    16.0: pushing(40.0),
    16.1: pushing(0.0),
}
DEVIATIONS: Final[Mapping[str, Mapping[str, float]]] = {
    "payload": {"BodyMass": 5.966},  # a kilogram more
    "slope": {"Slope": 0.0524},  # three degrees
    "friction": {"CoulombFriction": 0.04, "ViscousFriction": 2.0e-4},
    "radius": {"WheelRadius": 0.045},
}


def run(robot: str, script: Script, log: Path, *, differs: str = "", seed: int = 1) -> ResidualMonitor:
    """Drive a robot whose plant differs from the start on; a slope begins once it stands, since nothing lies on it."""
    values = dict(DEVIATIONS.get(differs, {}))
    slope = values.pop("Slope", 0.0)
    file = load_robot(robot)
    balance = Balance(file, pitch=0.5, seed=seed, plant=values)
    events = dict(script) | {3.0: lambda balance: balance.plant.write("Slope", slope)}
    period_ns = balance.robot.period_ns
    # A log is replayed with the model itself, without what `Balance` puts in front of it.
    as_is = dataclasses.replace(balance.robot, model=balance.model._model)
    balance.world = ScriptedStage({t: functools.partial(event, balance) for t, event in events.items()}, period_ns)
    written = CycleLog(log, layout_of(balance.robot), provenance_of(file))
    with contextlib.closing(written), contextlib.closing(balance._end):
        loop = as_is.loop(balance.world, written)
        loop.run(round(_DURATION_S[bool(script)] * 1e9 / period_ns))
    residual = loop._cycle.residual
    assert residual is not None
    return residual


def warnings_in(log: Path) -> list[str]:
    return [record.warning for record in RecordedRun(log).cycles() if record.warning is not None]


def test_a_slope_is_a_warning_and_no_fault_and_a_replay_has_it_too(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    residual = run("segway", {}, log, differs="slope")
    (warning,) = warnings_in(log)
    assert warning.startswith("the robot does not move as designed: slope +0.03")
    assert [record.mode for record in RecordedRun(log).cycles()][-1] is Mode.ARMED
    outcome = replay(log)
    assert outcome.is_identical
    assert outcome.is_whole
    assert residual.deviations.warned == [False, True, False, False]


@pytest.mark.proof
@pytest.mark.parametrize("robot", ["segway", "segway-odrive"])
@pytest.mark.parametrize("cause", CAUSES)
def test_what_has_changed_is_named_while_it_drives(robot: str, cause: str, tmp_path: Path) -> None:
    run(robot, DRIVES, tmp_path / "run.mcap", differs=cause)
    assert f"designed: {cause} " in warnings_in(tmp_path / "run.mcap")[0]


@pytest.mark.proof
@pytest.mark.parametrize("robot", ["segway", "segway-odrive"])
@pytest.mark.parametrize("script", [{}, DRIVES, PUSHES], ids=["stands", "drives", "is pushed"])
@pytest.mark.parametrize("seed", range(1, 6))
def test_the_robot_as_designed_is_not_warned_of(robot: str, script: Script, seed: int, tmp_path: Path) -> None:
    run(robot, script, tmp_path / "run.mcap", seed=seed)
    assert warnings_in(tmp_path / "run.mcap") == []

# SPDX-License-Identifier: MIT
"""What a log shows beside its simulation: next to nothing where the plant is the same, and what it is where not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from segway_ecc.hil.comparison.compare import Comparison, compare
from segway_ecc.hil.comparison.logged import read_run
from segway_ecc.hil.comparison.report import curves, document, render, text
from segway_ecc.hil.comparison.simulated import pieces_of
from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.hil.plants.cart import CartPlant
from segway_ecc.hil.plants.segway import SegwayPlant, SegwayTorquePlant
from segway_ecc.node.model.model import Model

DriveRecord = Callable[..., Path]


def compared(log: Path, plant: Model | None = None, window_s: float | None = None) -> Comparison:
    return compare(read_run(log), plant or SegwayPlant(), window_s, 0.001, lambda _done, _of: None)


def rms(found: Comparison, signal: str) -> float:
    return next(each.rms for each in found.residuals if each.name == signal)


def test_the_same_plant_shows_what_was_logged_but_for_the_errors_of_the_sensors(drive: DriveRecord) -> None:
    found = compared(drive())
    assert rms(found, "left.velocity") < 0.5  # of 47 rad/s
    assert rms(found, "imu.angular_velocity_y") < 0.1  # of 4.4 rad/s
    assert rms(found, "pitch") < 0.01
    # The accelerometer's bias, 0.05 m/s2 at one standard deviation, tilts the estimate by as much over gravity.
    assert abs(found.pitch_offset) < 0.015


@pytest.mark.parametrize(
    ("differs", "signal"), [(("Payload", 1.0), "left.velocity"), (("WheelRadius", 0.045), "imu.angular_velocity_y")]
)
def test_another_plant_shows_in_the_residuals(drive: DriveRecord, differs: tuple[str, float], signal: str) -> None:
    same = rms(compared(drive()), signal)
    other = rms(compared(drive(differs)), signal)
    assert other > 2.0 * same


def test_the_delay_is_the_one_with_which_least_differs(drive: DriveRecord) -> None:
    run = read_run(drive(), begin_s=1.0, end_s=1.6)
    steps: list[tuple[int, int]] = []
    found = compare(run, SegwayPlant(), None, None, lambda done, of: steps.append((done, of)))
    # A command is 0.25 ms on the bus, and the board looks for it as it measures.
    assert found.delay_s <= 0.002
    assert steps[-1][0] == steps[-1][1] == 12


def test_a_signal_is_only_there_where_it_was_simulated(drive: DriveRecord) -> None:
    found = compared(drive(seconds=1.6), window_s=0.1)
    simulated = np.isfinite(found.simulated["left.angle"])
    assert simulated.sum() == sum(piece.end - piece.first for piece in found.pieces)
    assert {piece.end - piece.first for piece in found.pieces} == {20}
    times, drawn = curves(found)
    assert [unit for _, unit, *_ in drawn][:2] == ["rad", "rad/s"]
    assert all(len(curve) == len(times) for _, _, *both in drawn for curve in both)


def test_no_window_reaches_over_missing_cycles(drive: DriveRecord) -> None:
    run = read_run(drive(seconds=2.0))
    cycles = run.cycles.copy()
    cycles[60:] += 7
    broken = type(run)(**{name: getattr(run, name) for name in run.__slots__} | {"cycles": cycles})
    for piece in pieces_of(broken, 0.1):
        assert piece.end <= 60 or piece.first >= 60
    assert len(pieces_of(broken, None)) == 2


def test_the_report_has_every_signal_in_its_unit(drive: DriveRecord) -> None:
    found = compared(drive(seconds=1.6))
    shown, rendered = text(found), render(found)
    assert "in 2 windows of 0.25 s, each from the logged motion" in shown
    for each in found.residuals:
        assert f"{each.name} " in shown
        assert each.name in rendered
    signals = document(found)["signals"]
    assert isinstance(signals, list)
    assert {"rms", "largest", "spread", "noise", "rms_per_spread", "rms_per_noise"} <= signals[0].keys()


def test_a_plant_of_other_motors_is_refused(drive: DriveRecord) -> None:
    log = drive(seconds=1.6)
    with pytest.raises(PlantMismatchError, match=r"takes left\.torque, right\.torque; the log has the commands"):
        compared(log, SegwayTorquePlant())


def test_a_plant_that_cannot_begin_in_a_motion_runs_from_its_own_start(drive: DriveRecord) -> None:
    class Unplaceable(CartPlant):
        begin_at = None  # type: ignore[assignment]

    found = compared(drive(seconds=1.6), Unplaceable())
    assert not found.begins_as_logged
    assert len(found.pieces) == 1
    assert "from where the plant always begins" in text(found)


def test_a_log_that_is_too_short_is_refused(drive: DriveRecord) -> None:
    log = drive(seconds=1.6)
    with pytest.raises(PlantMismatchError, match="give --window"):
        compared(log, window_s=5.0)

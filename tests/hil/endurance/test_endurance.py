# SPDX-License-Identifier: MIT
"""Short drives: what is counted, what trips, and the same figures every time."""

import itertools
import math

import pytest

from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.endurance import endurance
from segway_ecc.hil.endurance.driving import FIRST_S, MOST_AHEAD, MOST_BACK, MOST_TURNING, Driver, Leg, programme
from segway_ecc.hil.endurance.endurance import EndurancePlan, Stretch, Trip, drive, drive_seed, endure
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.setpoints import REST, Setpoint

SEGWAY = load_robot("segway")
CAN_OFF = Fault(target="can", type="off", at_s=1.0)


def whole(plan: EndurancePlan, jobs: int) -> tuple[list[Stretch], list[float]]:
    told: list[float] = []
    return endure(plan, jobs, told.append), told


def test_a_programme_is_within_the_usual_range_and_has_every_kind_of_piece() -> None:
    pieces = list(itertools.islice(programme(3), 400))
    assert pieces[0] == Leg(REST, 0.0, FIRST_S)
    for piece in pieces:
        assert -MOST_BACK <= piece.target.linear_velocity <= MOST_AHEAD
        assert abs(piece.target.angular_velocity) <= MOST_TURNING
        assert 0.0 <= piece.ramp_s < piece.lasts_s <= 15.0
    moving = {(math.copysign(1, p.target[0]) * bool(p.target[0]), bool(p.target[1])) for p in pieces[1:]}
    assert moving == {(0, False), (0, True), (1, False), (1, True), (-1, True)}
    assert {piece.ramp_s > 0.0 for piece in pieces} == {True, False}


def test_a_programme_is_its_seeds() -> None:
    first = [list(itertools.islice(programme(seed), 50)) for seed in (1, 1, 2)]
    assert first[0] == first[1] != first[2]


def test_a_driver_steps_ramps_and_goes_on() -> None:
    driver = Driver(1)
    pieces = list(itertools.islice(programme(1), 60))
    begun_s, before = 0.0, REST
    for piece in pieces:
        middle = Setpoint(*(0.5 * (a + b) for a, b in zip(before, piece.target, strict=True)))
        if piece.ramp_s:
            assert driver.setpoint(begun_s + 0.5 * piece.ramp_s) == pytest.approx(middle)
        assert driver.setpoint(begun_s + piece.ramp_s + 1e-9) == pytest.approx(piece.target)
        begun_s, before = begun_s + piece.lasts_s, piece.target
    assert driver.pieces == len(pieces)


def test_a_normal_drive_does_not_trip_and_follows() -> None:
    stretch = drive(SEGWAY, 1, 20.0, 0.0)
    assert stretch.trip is None
    assert (stretch.cycles, stretch.lost, stretch.refused) == (4000, 0, 0)
    assert stretch.simulated_s == pytest.approx(20.0)
    # Four sensor frames and two of a command in every cycle, status and session in every fourth, a few at the start.
    assert stretch.frames == pytest.approx(4000 * 6.5, rel=0.02)
    assert 0.02 < stretch.max_tilt_rad < 0.3
    assert 0.0 < stretch.max_velocity_error < 0.15
    assert 0.0 < stretch.max_yaw_rate_error < 0.1


def test_lost_frames_are_counted_and_the_same_seed_gives_the_same_figures() -> None:
    runs = [drive(SEGWAY, seed, 8.0, 0.02) for seed in (4, 4, 5)]
    assert runs[0] == runs[1] != runs[2]
    armed = 8.0 - 1.02  # it loses nothing before it is armed
    for run in runs:
        assert run.trip is None
        assert run.lost == pytest.approx(0.02 * armed / 8.0 * run.frames, rel=0.3)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (Fault(target="imu", type="stuck", at_s=2.0), "the IMU is frozen"),
        (CAN_OFF, "too old"),
    ],
)
def test_a_failed_sensor_is_a_trip_and_the_end(fault: Fault, reason: str) -> None:
    stretch = drive(SEGWAY, 1, 8.0, 0.0, faults=[fault])
    assert stretch.trip is not None
    assert stretch.trip.mode == "FAULT"
    assert reason in stretch.trip.reason
    # Armed after a second, and noticed within 0.15 s.
    assert 1.0 + fault.at_s < stretch.trip.at_s < 1.2 + fault.at_s
    assert stretch.simulated_s == pytest.approx(stretch.trip.at_s, abs=0.011)


def test_a_robot_that_never_arms_is_a_trip() -> None:
    # Arming takes a second.
    stretch = drive(SEGWAY, 1, 0.5, 0.0)
    assert stretch.trip is not None
    assert stretch.trip.reason.startswith("it was never armed: ")


def test_after_a_trip_another_robot_drives_on_until_the_time_is_up() -> None:
    told: list[float] = []
    plan = EndurancePlan(SEGWAY, 10.0, 0.0, 2, (CAN_OFF,))
    stretches = drive_seed(plan, 2, told.append)
    assert [stretch.seed for stretch in stretches] == [2, 4, 6]
    assert [stretch.trip is not None for stretch in stretches] == [True] * 3
    assert sum(stretch.simulated_s for stretch in stretches) == pytest.approx(5.0, abs=0.011)
    assert told[-1] == pytest.approx(5.0, abs=0.011)


def test_one_that_trips_again_and_again_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def trip(_file: object, seed: int, *_: object, **__: object) -> Stretch:
        return Stretch(seed, 2.0, 400, Trip(2.0, "FAULT", "it always does"), 0.5, 0.0, 0.0, 0, 0, 0)

    monkeypatch.setattr(endurance, "drive", trip)
    stretches = drive_seed(EndurancePlan(SEGWAY, 1000.0, 0.0, 1), 1, lambda _: None)
    assert [stretch.seed for stretch in stretches] == list(range(1, 21))


def test_how_many_processes_there_are_changes_nothing() -> None:
    plan = EndurancePlan(SEGWAY, 6.0, 0.02, 2)
    alone, told_alone = whole(plan, 1)
    both, told_both = whole(plan, 2)
    assert alone == both
    assert [stretch.seed for stretch in alone] == [1, 2]
    assert told_alone == sorted(told_alone)
    assert told_alone[-1] == pytest.approx(6.0)
    assert told_both


def test_on_an_interface_both_ends_are_the_kernels_and_the_seeds_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str]] = []

    def ends(rig: LockstepRig, channels: tuple[str, str], _can: CanSettings) -> tuple[Link, Link]:
        asked.append(channels)
        return rig.bus.attach("node"), rig.bus.attach("plant")

    monkeypatch.setattr(endurance, "kernel_ends", ends)
    plan = EndurancePlan(SEGWAY, 4.0, 0.0, 2, channel="can7")
    found, told = whole(plan, 2)  # in this process, or the other one would not know our ends
    assert asked == [("can7", "can7")] * 2
    assert found == whole(plan._replace(channel=None), 1)[0]
    assert told[-1] == pytest.approx(4.0)

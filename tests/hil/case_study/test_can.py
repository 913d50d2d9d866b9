# SPDX-License-Identifier: MIT
"""The CAN seat: in lock step, and in real time over the virtual bus."""

from pathlib import Path

import pytest

from segway_ecc.hil.case_study import can as can_seat
from segway_ecc.hil.case_study.can import LockstepCanSeat, RealTimeCanSeat
from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.case_study.study import Seat, Trajectory
from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry, Segment, single_segment

pytestmark = pytest.mark.real_time


def close_to_offline(found: Trajectory, manoeuvre: Manoeuvre, tmp_path: Path, within: float) -> None:
    logs = tmp_path / "offline"
    logs.mkdir()
    offline = OfflineSeat(logs).run("same", manoeuvre).trajectory
    assert found.x[-1] == pytest.approx(offline.x[-1], abs=within)
    assert found.y[-1] == pytest.approx(offline.y[-1], abs=within)


def test_lock_step_gives_the_same_bits_every_time_and_ends_where_the_model_does(tmp_path: Path) -> None:
    manoeuvre = Manoeuvre(
        segments=(Segment(linear=1.0, angular=0.5, duration=0.6), Segment(linear=0.5, angular=-2.0, duration=0.4))
    )
    first, second = (LockstepCanSeat(None).run(name, manoeuvre).trajectory for name in ("first", "second"))

    assert first == second
    assert first.seat is Seat.CAN
    close_to_offline(first, manoeuvre, tmp_path, 0.02)


def test_a_trajectory_is_a_point_every_hundredth_of_a_second_from_rest_to_the_end() -> None:
    found = LockstepCanSeat(None).run("points", single_segment(1.0, 0.0, 0.5)).trajectory

    assert found.time == pytest.approx([0.01 * index for index in range(51)])
    assert {len(values) for values in (found.x, found.y, found.linear_velocity, found.angular_velocity)} == {51}
    assert (found.x[0], found.y[0], found.linear_velocity[0]) == (0.0, 0.0, 0.0)
    # A first-order lag of about 65 ms, seven of which have passed.
    assert found.linear_velocity[-1] == pytest.approx(1.0, abs=0.02)


def test_lock_step_keeps_a_log_where_it_is_asked_for(tmp_path: Path) -> None:
    LockstepCanSeat(tmp_path).run("kept", single_segment(1.0, 0.0, 0.1))

    assert [path.name for path in tmp_path.iterdir()] == ["can_kept.mcap"]


def test_two_processes_in_real_time_end_where_the_model_does(tmp_path: Path) -> None:
    manoeuvre = single_segment(1.0, 0.5, 1.0)
    found = RealTimeCanSeat(tmp_path, tmp_path).run("real", manoeuvre).trajectory

    assert found.time == pytest.approx([0.01 * index for index in range(101)])
    close_to_offline(found, manoeuvre, tmp_path, 0.05)
    assert (tmp_path / "can_real.mcap").read_bytes().endswith(b"\x89MCAP0\r\n")


def test_a_controller_that_fails_is_reported_with_its_messages(tmp_path: Path) -> None:
    # The controller's log cannot be written here.
    (tmp_path / "file").touch()
    with pytest.raises(ProcessFailedError, match=r"ended with exit code 9: .*cannot write the log"):
        RealTimeCanSeat(tmp_path, tmp_path / "file").run("fails", single_segment(1.0, 0.0, 0.1))


def test_on_a_virtual_bus_runs_go_side_by_side_and_on_a_real_one_they_take_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_seat, "socketcan_interfaces", lambda: ["can0", "can1"])
    real = RealTimeCanSeat(tmp_path, tmp_path)
    monkeypatch.setattr(can_seat, "socketcan_interfaces", list)
    virtual = RealTimeCanSeat(tmp_path, tmp_path)

    assert real.jobs == 1
    assert virtual.jobs > 1


def test_the_truth_is_read_by_the_names_of_its_columns(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(
        "wall_ns,left.angle,truth.heading,truth.y,truth.x,truth.angular_velocity,truth.linear_velocity\r\n"
        "1700000000000000001,9.0,3.0,2.0,1.0,5.0,4.0\r\n",
        "utf-8",
    )

    assert can_seat.read_truth(path) == [Odometry(1_700_000_000_000_000_001, 1.0, 2.0, 3.0, 4.0, 5.0)]


def test_points_lie_on_the_line_between_the_ticks_around_them() -> None:
    ticks = [Odometry(ns * 1_000_000, 1.0 * ns, -2.0 * ns, 0.0, 5.0, 0.0) for ns in (0, 4, 8, 16, 24, 32)]
    found = can_seat.resample(ticks, 2_000_000, 20_000_000)

    assert [point.stamp_ns for point in found] == [2_000_000, 12_000_000, 22_000_000]
    assert [point.x for point in found] == pytest.approx([2.0, 12.0, 22.0])
    assert [point.y for point in found] == pytest.approx([-4.0, -24.0, -44.0])
    assert {point.linear_velocity for point in found} == {5.0}


def test_a_point_on_a_tick_is_that_tick() -> None:
    ticks = [Odometry(ns, float(ns), 0.0, 0.0, 0.0, 0.0) for ns in (0, 10_000_000, 20_000_000)]

    found = can_seat.resample(ticks, 0, 20_000_000)
    assert [point.x for point in found] == [0.0, 10_000_000.0, 20_000_000.0]

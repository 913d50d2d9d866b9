# SPDX-License-Identifier: MIT
"""Ports and drives in lock step: counts and limits, which hold on any machine; no times."""

import pytest

from segway_ecc.hil.growth import lock_step
from segway_ecc.hil.growth.cost import Axis


def test_a_model_with_many_ports_runs_and_its_cost_is_positive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock_step, "PORTS_CYCLES", 260)
    point = lock_step.measure_ports(64)
    assert (point.axis, point.size, point.refused) == (Axis.PORTS, 64, "")
    assert point.cost is not None
    assert 0.0 < point.cost.p50_us <= point.cost.p99_us


def test_more_ports_than_a_record_has_room_for_do_not_run() -> None:
    point = lock_step.measure_ports(8192)
    assert point.cost is None
    assert "too many signals and ports" in point.refused


@pytest.mark.parametrize("count", [2, 6])
def test_each_drive_is_armed_and_takes_a_frame_in_each_cycle(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(lock_step, "DRIVES_CYCLES", 20)
    point = lock_step.measure_drives(count)
    assert point.cost is not None
    assert point.cost.notes["mode"] == "ARMED"
    sent, received = map(float, point.cost.notes["frames out, in per cycle"].split(", "))
    # Each drive: a torque a cycle; of 10 ms 2 estimates, half a heartbeat and one current come back, and some answers.
    assert sent == pytest.approx(count, rel=0.1)
    assert 3.0 * count < received < 4.5 * count


def test_a_bus_that_is_full_lets_no_drive_be_armed(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 1 Mbit/s the frames of 20 drives take more than the 10 ms of a cycle."""
    monkeypatch.setattr(lock_step, "DRIVES_CYCLES", 20)
    point = lock_step.measure_drives(20)
    assert point.cost is not None
    assert point.cost.notes["mode"] == "DISARMED"

# SPDX-License-Identifier: MIT
"""The study on scripted measurements: rounds, lines, tables, report."""

import json

import pytest

from segway_ecc.hil.growth import study
from segway_ecc.hil.growth.cost import Axis, Cost, Point
from segway_ecc.hil.growth.study import AxisResult, conduct, figure, grown, render, text, verdict


def cost(p50_us: float, **notes: str) -> Cost:
    return Cost(p50_us=p50_us, p99_us=3 * p50_us, spread_us=1.0, notes=notes)


def ports(size: int) -> Point:
    if size > 100:
        return Point(axis=Axis.PORTS, size=size, cost=None, refused="no room")
    return Point(axis=Axis.PORTS, size=size, cost=cost(10.0 + size))


class Subscribers:
    """Costs more each time it is asked."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __call__(self, size: int) -> Point:
        self.asked.append(size)
        return Point(axis=Axis.SUBSCRIBERS, size=size, cost=cost(100.0 + 5 * size + len(self.asked), late="1 %"))


SIZES = {Axis.PORTS: (2, 4, 8, 16, 200), Axis.SUBSCRIBERS: (0, 2, 4, 8)}


def test_real_time_is_run_twice_and_the_rounds_are_put_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "missing_packages", lambda: ())
    subscribers, told = Subscribers(), list[tuple[int, int]]()
    found = conduct(SIZES, lambda done, of: told.append((done, of)), {Axis.PORTS: ports, Axis.SUBSCRIBERS: subscribers})
    assert subscribers.asked == [0, 2, 4, 8, 0, 2, 4, 8]
    assert told == [(done, 13) for done in range(1, 14)]
    first = found[1].points[0].cost
    assert first is not None
    assert (first.p50_us, first.spread_us) == (103.0, 4.0)  # 101 and 105


def test_without_ros_nothing_that_needs_it_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "missing_packages", lambda: ("rclpy",))
    found = conduct(SIZES, lambda _done, _of: None, {Axis.PORTS: ports})
    assert [one.axis for one in found] == [Axis.PORTS]


def test_what_does_not_run_ends_the_table_and_is_no_part_of_the_line() -> None:
    one = grown(Axis.PORTS, [ports(size) for size in SIZES[Axis.PORTS]])
    assert one.line is not None
    assert one.line.at_zero == pytest.approx(10.0)
    assert one.line.up_to == 16
    assert verdict(one) == (
        "model ports: 10.0 us and 1 us for each, linear up to 16, the most that was tried; 200 do not run: no room"
    )
    assert grown(Axis.PORTS, [ports(2), ports(4)]).line is None
    assert "too few sizes" in verdict(grown(Axis.PORTS, [ports(2)]))


def bent() -> AxisResult:
    costs = {1: 10.0, 2: 12.0, 4: 16.0, 8: 60.0}
    return grown(Axis.ROBOTS, [Point(axis=Axis.ROBOTS, size=n, cost=cost(c, late="3 %")) for n, c in costs.items()])


def test_where_it_stops_being_linear_is_reported() -> None:
    assert "linear up to 4; at 8 it is +36.0 us off (spread 1.0 us)" in verdict(bent())
    table = text([bent()])
    assert table.splitlines()[1].split("  ")[-1].strip() == "late"
    assert table.splitlines()[-1].split() == ["8", "60.0", "180.0", "1.0", "24.0", "3", "%"]


def test_the_report_shows_every_axis_and_is_the_same_each_time() -> None:
    found = [grown(Axis.PORTS, [ports(size) for size in SIZES[Axis.PORTS]]), bent()]
    page = render(found, {"Machine": "a <machine>"})
    assert page == render(found, {"Machine": "a <machine>"})
    assert "a &lt;machine&gt;" in page
    assert "Model ports" in page
    assert "+36.0 us off" in page
    assert figure(found).startswith(b"<?xml")
    json.dumps([verdict(one) for one in found])

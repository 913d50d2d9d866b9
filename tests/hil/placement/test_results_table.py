# SPDX-License-Identifier: MIT
"""What was found, as text and as a page."""

from segway_ecc.hil.placement.judging import RunOutcome
from segway_ecc.hil.placement.report import render
from segway_ecc.hil.placement.results import Bound, tables, text
from tests.hil.placement.scripted import R, S, cut, drive, found, stop

DELAY = Bound(
    robot="segway", what="delay", unit="s", tolerated=0.0575, lost=0.058, lost_by="it <shakes>", theory=0.0319
)
LOSS = Bound(robot="segway", what="loss", unit="1", tolerated=0.64, lost=None, lost_by="")
FOUND = found(
    drive((R, R, R), "near", off_m=0.0),
    drive((R, R, R), "far", off_m=0.0),
    drive((S, R, S), "near", "cmd_vel", off_m=0.0123),
    drive((S, R, S), "far", "cmd_vel", RunOutcome.FELL),
    stop((S, R, S), 0.055, 0.0605, network="near", setpoints="cmd_vel"),
    stop((S, R, S), None, network="far", setpoints="cmd_vel"),
    cut((S, R, S), RunOutcome.HELD, "cmd_vel"),
    DELAY,
    LOSS,
)


def rows_of(title: str) -> list[tuple[str, ...]]:
    (table,) = [table for table in tables(FOUND) if table.title == title]
    return [tuple(table.head), *map(tuple, table.rows)]


def test_a_row_for_each_placement_and_a_column_for_each_network() -> None:
    assert rows_of("Largest distance from the robot with all control on board, m") == [
        ("sequence", "balance", "supervision", "set-points on", "near", "far"),
        ("robot", "robot", "robot", "-", "0.000", "0.000"),
        ("station", "robot", "station", "cmd_vel", "0.012", "fell"),
    ]


def test_each_measure_has_its_own_table() -> None:
    first = {table.title: table.rows[0][4] for table in tables(FOUND) if "near" in table.head}
    assert list(first.values()) == ["0.000", "0.000", "0.250", "0.125", "0.375", "60"]


def test_the_longest_stop_counts_and_one_that_did_not_come_is_none() -> None:
    assert rows_of("From pressing stop to zero torque, the longest of all presses, ms")[1:] == [
        ("station", "robot", "station", "cmd_vel", "60", "-")
    ]


def test_bounds_are_reported_in_their_unit_with_what_theory_gives() -> None:
    assert rows_of("Limits of balance control on the station")[1:] == [
        ("segway", "delay", "57.5 ms", "58 ms", "31.9 ms", "it <shakes>"),
        ("segway", "loss", "64 %", "more than was tried", "-", ""),
    ]


def test_the_recommendation_is_reported_for_each_network_and_for_all() -> None:
    assert rows_of("Recommended placement") == [
        ("network", "placement"),
        ("near", "sequence and supervision on the station, cmd_vel"),
        ("far", "all on the robot"),
        ("all", "all on the robot"),
    ]


def test_text_is_aligned_and_leaves_nothing_out() -> None:
    lines = text(FOUND).splitlines()
    head = next(line for line in lines if "set-points on" in line)
    row = next(line for line in lines if "0.012" in line)
    assert head.index("near") == row.index("0.012")
    assert "+0.50 s HOLD <here>" in text(FOUND)


def test_the_page_loads_nothing_and_escapes_what_it_shows() -> None:
    page = render(FOUND, {"Robot": "a <robot>"})
    assert page.startswith("<!DOCTYPE html>")
    assert page.count("data:image/svg+xml;base64,") == 3
    assert "<here>" not in page
    assert "+0.50 s HOLD &lt;here&gt;" in page
    assert "a &lt;robot&gt;" in page
    assert "http" not in page
    assert "<strong>all on the robot</strong>" in page
    assert render(FOUND, {"Robot": "a <robot>"}) == page


def test_a_page_of_nothing_is_a_page() -> None:
    assert "<strong>none is fit</strong>" in render(found(), {})

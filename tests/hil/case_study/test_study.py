# SPDX-License-Identifier: MIT
import re
import subprocess
import sys
from dataclasses import replace

from segway_ecc.hil.case_study.study import (
    Cell,
    Seat,
    difference,
    difference_text,
    table,
    thesis_cells,
    worst_difference,
    worst_text,
    worst_thesis_difference,
)


def _cells(*seats: Seat, shift: float = 0.0123) -> list[Cell]:
    return [
        replace(cell, positions=dict.fromkeys(seats, (cell.thesis_offline[0] + shift, cell.thesis_offline[1])))
        for cell in thesis_cells()
    ]


def _rows(text: str) -> list[list[float]]:
    lines = [line for line in text.splitlines() if re.match(r" *\d", line)]
    return [[float(number) for number in line.split()] for line in lines]


def test_every_row_holds_the_numbers_of_its_cell() -> None:
    cells = _cells(Seat.OFFLINE)
    for row, cell in zip(_rows(table(cells, [Seat.OFFLINE])), cells, strict=True):
        x, y = cell.positions[Seat.OFFLINE]
        error = difference((x, y), cell.thesis_offline)
        expected = [cell.linear, cell.angular, *cell.thesis_offline, *cell.thesis_ros, round(x, 3), round(y, 3)]
        assert row == [*expected, round(error, 4)]


def test_columns_are_aligned_and_fit_a_terminal() -> None:
    lines = table(_cells(*Seat), list(Seat)).splitlines()
    head, rule, *rows = lines[1 : lines.index("")]
    assert {len(line) for line in (head, rule, *rows)} == {len(rule)}
    assert len(rule) <= 104


def test_ends_with_the_worst_difference_of_each_seat() -> None:
    cells = _cells(Seat.OFFLINE, Seat.CAN)
    worst = worst_difference(cells, Seat.CAN)
    lines = table(cells, list(Seat)).splitlines()
    assert lines[-4:] == [
        f"offline   {worst:.4f} m",
        "submodel  did not run",
        "ros       did not run",
        f"can       {worst:.4f} m",
    ]
    assert f"{worst_thesis_difference(cells):.2f} m" in lines[-5]


def test_the_difference_of_a_row_is_the_worst_of_its_seats() -> None:
    cell = thesis_cells()[3]
    x, y = cell.thesis_offline
    apart = replace(cell, positions={Seat.OFFLINE: (x, y + 0.001), Seat.CAN: (x - 0.25, y)})
    assert _rows(table([apart], list(Seat)))[0][-1] == 0.25


def test_a_seat_that_ran_nowhere_has_no_column() -> None:
    assert "ros" not in table(_cells(Seat.CAN), list(Seat)).splitlines()[0]


def test_a_cell_that_a_seat_did_not_run_is_marked() -> None:
    bare = thesis_cells()[0]
    assert "not run" in table([bare, *_cells(Seat.CAN)], [Seat.CAN]).splitlines()[3]
    assert difference_text(bare, Seat.CAN) == "not run"
    assert worst_text([bare], Seat.CAN) == "did not run"


def test_negative_zero_is_printed_as_zero() -> None:
    cell = replace(thesis_cells()[0], positions={Seat.OFFLINE: (-0.0, -1e-9)})
    assert "-0.0" not in table([cell], [Seat.OFFLINE])


def test_without_cells_or_seats_there_is_still_a_heading() -> None:
    assert "rad/s" in table([], [])


def test_needs_no_matplotlib() -> None:
    code = "import sys, segway_ecc.hil.case_study.study; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from segway_ecc.hil.case_study.seats import SUBMODEL_CART, OfflineSeat
from segway_ecc.hil.case_study.study import Cell, Seat, difference, thesis_cells
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

CELLS = thesis_cells()


@pytest.fixture
def seats(tmp_path: Path) -> list[OfflineSeat]:
    return [OfflineSeat(tmp_path), OfflineSeat(tmp_path, Seat.SUBMODEL, SUBMODEL_CART)]


@pytest.mark.compiler
@pytest.mark.parametrize("cell", CELLS, ids=[f"{c.linear:g} {c.angular:g}" for c in CELLS])
def test_every_cell_is_that_of_the_thesis_within_its_rounding(seats: list[OfflineSeat], cell: Cell) -> None:
    manoeuvre = Manoeuvre(segments=(Segment(linear=cell.linear, angular=cell.angular, duration=10.0),))
    for seat in seats:
        assert difference(seat.run("cell", manoeuvre).position, cell.thesis_offline) <= 0.006


@pytest.mark.compiler
def test_a_run_has_every_step_from_start_to_end_and_a_log(seats: list[OfflineSeat], tmp_path: Path) -> None:
    manoeuvre = Manoeuvre(segments=(Segment(linear=1.0, duration=0.5), Segment(linear=-1.0, duration=0.5)))
    for seat in seats:
        run = seat.run("short", manoeuvre)
        assert len(run.trajectory.time) == 101
        assert run.trajectory.time[-1] == pytest.approx(1.0)
        assert run.trajectory.x[50] == pytest.approx(0.435, abs=0.01)
        assert run.trajectory.linear_velocity[-1] < 0.0
        assert (tmp_path / f"{seat.seat}_short.mcap").stat().st_size > 0


def test_segments_that_end_between_cycles_take_as_many_as_on_the_robot(tmp_path: Path) -> None:
    run = OfflineSeat(tmp_path).run("between", Manoeuvre(segments=(Segment(linear=1.0, duration=0.015),) * 2))
    assert len(run.trajectory.time) == 4

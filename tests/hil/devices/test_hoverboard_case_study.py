# SPDX-License-Identifier: MIT
"""The case study on a simulated hoverboard, in lock step with the node: a serial line is all there is."""

from pathlib import Path

import pytest

from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.case_study.study import Cell, difference, thesis_cells
from segway_ecc.node.sequence.manoeuvre import single_segment


@pytest.mark.parametrize(("linear", "angular", "duration"), [(2.0, 2.0, 10.0), (1.0, -0.5, 2.0)])
def test_the_cart_ends_where_the_model_does(tmp_path: Path, linear: float, angular: float, duration: float) -> None:
    manoeuvre = single_segment(linear, angular, duration)
    found = LockstepCanSeat(None, "cart-hoverboard").run("t", manoeuvre).trajectory
    offline = OfflineSeat(tmp_path).run("same", manoeuvre).trajectory
    assert found.x[-1] == pytest.approx(offline.x[-1], abs=0.12)
    assert found.y[-1] == pytest.approx(offline.y[-1], abs=0.12)
    assert abs(found.x[-1]) + abs(found.y[-1]) > 0.5 or duration > 5.0, "it did move"


@pytest.mark.parametrize(
    "cell",
    [cell for cell in thesis_cells() if cell.linear <= 4.0],
    ids=lambda cell: f"{cell.linear:g}-{cell.angular:g}",
)
def test_the_cart_ends_where_the_thesis_has_it_up_to_4_m_s(cell: Cell) -> None:
    """At 6 m/s the steps of the board's timer decide how far off it is: see the page of the drive."""
    run = LockstepCanSeat(None, "cart-hoverboard").run("cell", single_segment(cell.linear, cell.angular, 10.0))
    assert difference(run.position, cell.thesis_offline) < 0.06

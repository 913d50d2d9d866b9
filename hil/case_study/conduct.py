# SPDX-License-Identifier: MIT
"""Conducting the study: every cell and figure through every seat, side by side where a seat allows it."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Final

from segway_ecc.hil.case_study.seats import SeatRun, SeatRunner
from segway_ecc.hil.case_study.study import Cell, Seat, Study, Trajectory, thesis_cells
from segway_ecc.hil.errors import RigError
from segway_ecc.node.errors import NodeError
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment, single_segment

DURATION_S: Final = 10.0
TURN: Final = "turn"
_TURN_MANOEUVRE: Final = Manoeuvre(
    segments=(
        Segment(linear=1.0, angular=0.5, duration=DURATION_S),
        Segment(linear=1.0, angular=-0.5, duration=DURATION_S),
    )
)

OnProgress = Callable[[Seat, int, int], None]
"""Called with the seat, how many of its runs are done, and how many there are."""


def conduct(runners: Sequence[SeatRunner], facts: Mapping[str, str], on_progress: OnProgress) -> Study:
    """SeatRun the twelve cells and the turn in each seat.

    Raises:
        NodeError, RigError: A run failed; the first failure ends the study.
    """
    cells = thesis_cells()
    runs = {runner.seat: _run_seat(runner, cells, on_progress) for runner in runners}
    turns = [of_seat[TURN].trajectory for of_seat in runs.values()]
    graphs = [of_seat[TURN].graph for of_seat in runs.values()]
    ends = [{seat: of_seat[cell_name(cell)].position for seat, of_seat in runs.items()} for cell in cells]
    return Study(
        cells=[dataclasses.replace(cell, positions=at) for cell, at in zip(cells, ends, strict=True)],
        seats=list(runs),
        velocities=[_first(turn, DURATION_S) for turn in turns],
        turn=turns,
        graph=next((graph for graph in graphs if graph), ()),
        facts=facts,
    )


def cell_name(cell: Cell) -> str:
    """A name for the cell's run."""
    return f"linear_{cell.linear:g}_angular_{cell.angular:g}"


def _run_seat(runner: SeatRunner, cells: Sequence[Cell], on_progress: OnProgress) -> dict[str, SeatRun]:
    # The longest first, so that it does not run alone at the end.
    manoeuvres = {TURN: _TURN_MANOEUVRE}
    manoeuvres |= {cell_name(cell): single_segment(cell.linear, cell.angular, DURATION_S) for cell in cells}
    on_progress(runner.seat, 0, len(manoeuvres))
    runs: dict[str, SeatRun] = {}
    with ThreadPoolExecutor(runner.jobs) as pool:
        futures = {pool.submit(runner.run, name, manoeuvre): name for name, manoeuvre in manoeuvres.items()}
        try:
            for future in as_completed(futures):
                runs[futures[future]] = future.result()
                on_progress(runner.seat, len(runs), len(futures))
        except (NodeError, RigError):
            for future in futures:
                future.cancel()
            raise
    return runs


def _first(whole: Trajectory, duration_s: float) -> Trajectory:
    """The beginning of a trajectory."""
    count = sum(time <= duration_s for time in whole.time)
    fields = (field.name for field in dataclasses.fields(whole) if field.name != "seat")
    return dataclasses.replace(whole, **{name: getattr(whole, name)[:count] for name in fields})

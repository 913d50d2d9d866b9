# SPDX-License-Identifier: MIT
"""Conducting a study with seats that only pretend to run."""

import threading
from concurrent.futures import Future
from typing import Self

import pytest

from segway_ecc.hil.case_study.seats import DURATION_S, TURN, Repeats, SeatRun, cell_name, conduct
from segway_ecc.hil.case_study.study import Edge, Seat, Trajectory, thesis_cells
from segway_ecc.hil.errors import RigError, RunFailedError, SpoiledRunError
from segway_ecc.node.errors import NodeError
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

EDGE = Edge("/a", "/t", "std_msgs/msg/Float64", "/b")


class PretendSeat:
    """A seat that ends where its set-points say, plus an offset, and passes 1 s, 10 s and the end."""

    def __init__(self, seat: Seat, offset: float = 0.0, jobs: int = 1, graph: tuple[Edge, ...] = ()) -> None:
        self.seat = seat
        self.jobs = jobs
        self.tries = 1
        self.played: dict[str, Manoeuvre] = {}
        self.fails_at: str | None = None
        self.fails_until_try = 1
        self.failure: type[Exception] = RigError
        self._offset = offset
        self._graph = graph
        self._lock = threading.Lock()

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        with self._lock:
            self.played[name] = manoeuvre
        if self.fails_at is not None and name in (self.fails_at, f"{self.fails_at}_try_{self.fails_until_try}"):
            raise self.failure(f"{name} broke")
        first = manoeuvre.segments[0]
        end = (first.linear + self._offset, first.angular - self._offset)
        times = [0.0, 1.0, 10.0] if len(manoeuvre.segments) == 1 else [0.0, 1.0, 10.0, 10.01, 20.0]
        count = len(times)
        xs, ys = [*([0.0] * (count - 1)), end[0]], [*([0.0] * (count - 1)), end[1]]
        return SeatRun(Trajectory(self.seat, times, xs, ys, times, times), self._graph)


def no_progress(_seat: Seat, _done: int, _total: int) -> None:
    pass


def test_every_cell_of_the_thesis_is_played_for_ten_seconds_in_each_seat() -> None:
    seats = [PretendSeat(Seat.OFFLINE), PretendSeat(Seat.CAN, jobs=3)]
    conduct(seats, {}, no_progress)

    for seat in seats:
        played = dict(seat.played)
        turn = played.pop(TURN)
        assert turn.segments == (
            Segment(linear=1.0, angular=0.5, duration=10.0),
            Segment(linear=1.0, angular=-0.5, duration=10.0),
        )
        assert {manoeuvre.segments for manoeuvre in played.values()} == {
            (Segment(linear=cell.linear, angular=cell.angular, duration=10.0),) for cell in thesis_cells()
        }
        assert len(played) == 12


def test_the_longest_run_starts_first() -> None:
    seat = PretendSeat(Seat.OFFLINE)
    conduct([seat], {}, no_progress)

    assert next(iter(seat.played)) == TURN


def test_each_cell_gets_the_position_of_its_own_run_in_each_seat() -> None:
    study = conduct([PretendSeat(Seat.OFFLINE), PretendSeat(Seat.CAN, 0.25, jobs=5)], {}, no_progress)

    assert study.seats == [Seat.OFFLINE, Seat.CAN]
    assert [(cell.linear, cell.angular) for cell in study.cells] == [
        (cell.linear, cell.angular) for cell in thesis_cells()
    ]
    for cell in study.cells:
        assert cell.positions == {
            Seat.OFFLINE: (cell.linear, cell.angular),
            Seat.CAN: (cell.linear + 0.25, cell.angular - 0.25),
        }


def test_the_velocities_are_the_first_ten_seconds_of_the_turn() -> None:
    study = conduct([PretendSeat(Seat.ROS), PretendSeat(Seat.CAN)], {}, no_progress)

    assert DURATION_S == 10.0
    assert [turn.seat for turn in study.turn] == [Seat.ROS, Seat.CAN]
    assert [list(turn.time) for turn in study.turn] == [[0.0, 1.0, 10.0, 10.01, 20.0]] * 2
    for first in study.velocities:
        for values in (first.time, first.linear_velocity, first.angular_velocity):
            assert list(values) == [0.0, 1.0, 10.0]
        assert len(first.x) == len(first.y) == 3


def test_the_graph_is_that_of_the_seat_that_has_one_and_facts_are_handed_on() -> None:
    study = conduct([PretendSeat(Seat.OFFLINE), PretendSeat(Seat.ROS, graph=(EDGE,))], {"CAN bus": "x"}, no_progress)

    assert study.graph == (EDGE,)
    assert study.facts == {"CAN bus": "x"}
    assert conduct([PretendSeat(Seat.OFFLINE)], {}, no_progress).graph == ()


def test_progress_is_reported_from_none_to_all() -> None:
    told: list[tuple[Seat, int, int]] = []
    conduct([PretendSeat(Seat.CAN, jobs=4)], {}, lambda *progress: told.append(progress))

    assert told == [(Seat.CAN, done, 13) for done in range(14)]


class OnlyFirstRuns:
    """A pool whose first run fails at once, while all others still wait for their turn."""

    def __init__(self, _jobs: int) -> None:
        self.futures: list[Future[SeatRun]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        assert [future.cancelled() for future in self.futures] == [False] + [True] * 12

    def submit(self, *_call: object) -> Future[SeatRun]:
        future: Future[SeatRun] = Future()
        if not self.futures:
            future.set_exception(NodeError("it broke"))
        self.futures.append(future)
        return future


def test_after_a_failure_what_waits_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.hil.case_study.seats.ThreadPoolExecutor", OnlyFirstRuns)
    with pytest.raises(NodeError, match=r"^it broke$"):
        conduct([PretendSeat(Seat.OFFLINE)], {}, no_progress)


def test_the_first_failure_ends_the_study_and_no_other_seat_is_begun() -> None:
    cells = thesis_cells()
    first, second = PretendSeat(Seat.OFFLINE), PretendSeat(Seat.CAN)
    first.fails_at = cell_name(cells[0])
    with pytest.raises(RigError, match=f"^{first.fails_at} broke$"):
        conduct([first, second], {}, no_progress)

    assert second.played == {}


def test_a_seat_in_real_time_repeats_a_run_that_failed_and_reports_it() -> None:
    seat, reported = PretendSeat(Seat.ROS, jobs=3), list[str]()
    seat.tries, seat.fails_at, seat.fails_until_try = 3, TURN, 2
    study = conduct([seat], {}, no_progress, Repeats(reported.append))

    assert [name for name in seat.played if name.startswith(TURN)] == [TURN, f"{TURN}_try_2", f"{TURN}_try_3"]
    assert study.turn[0].time[-1] == 20.0
    assert study.repeated == reported
    assert reported == [
        "ros turn, try 1 of 3: turn broke",
        "ros turn, try 2 of 3: turn_try_2 broke",
    ]


def test_a_run_that_fails_three_times_ends_the_study_with_cause_and_remedy() -> None:
    seat = PretendSeat(Seat.ROS)
    seat.tries, seat.fails_at, seat.fails_until_try = 2, TURN, 2
    with pytest.raises(
        RunFailedError, match=r"^ros turn failed in each of 2 tries, the last time: turn_try_2 broke; end"
    ):
        conduct([seat], {}, no_progress)

    assert RunFailedError.exit_code == 14


def test_a_seat_that_the_machine_spoiled_has_no_result_and_fails_no_other() -> None:
    spoiled, other = PretendSeat(Seat.CAN), PretendSeat(Seat.OFFLINE)
    spoiled.tries, spoiled.fails_at, spoiled.fails_until_try, spoiled.failure = 2, TURN, 2, SpoiledRunError
    study = conduct([spoiled, other], {}, no_progress)

    assert study.seats == [Seat.OFFLINE]
    assert {tuple(cell.positions) for cell in study.cells} == {(Seat.OFFLINE,)}
    assert study.real_time is not None
    assert study.real_time.is_spoiled
    assert "(its table): no result. can turn failed in each of 2 tries, the last time: turn_try_2 broke" in (
        study.real_time.text
    )


def test_names_of_runs_are_unique_and_show_their_setpoints() -> None:
    names = [cell_name(cell) for cell in thesis_cells()]

    assert len(set(names)) == 12
    assert "linear_6_angular_4" in names

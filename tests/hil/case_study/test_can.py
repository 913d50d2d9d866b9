# SPDX-License-Identifier: MIT
"""The CAN seat: in lock step, and in real time over the virtual bus."""

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from segway_ecc.hil.case_study import can as can_seat
from segway_ecc.hil.case_study.can import LockstepCanSeat, RealTimeCanSeat, run_in_real_time
from segway_ecc.hil.case_study.seats import OfflineSeat, Repeats, SeatRun
from segway_ecc.hil.case_study.study import LoopTiming, Seat, Trajectory
from segway_ecc.hil.errors import RigError, SpoiledRunError
from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.hil.witness import Stalls
from segway_ecc.node.config import read_text
from segway_ecc.node.errors import RobotLostError, SequenceError
from segway_ecc.node.replay.replay import replay
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


def test_its_log_is_replayed_to_the_last_bit(tmp_path: Path) -> None:
    LockstepCanSeat(tmp_path).run("kept", single_segment(1.0, 0.0, 0.1))
    outcome = replay(tmp_path / "can_kept.mcap")

    assert (outcome.is_whole, outcome.is_identical) == (True, True)
    assert outcome.cycles > 0


def robot(tmp_path: Path, old: str, new: str) -> str:
    text = read_text("cart-can")
    assert old in text
    (tmp_path / "robot.yaml").write_text(text.replace(old, new))
    return str(tmp_path / "robot.yaml")


def test_a_refused_manoeuvre_is_an_error_with_the_robots_reason(tmp_path: Path) -> None:
    limited = robot(tmp_path, "max_linear_velocity: 10.0", "max_linear_velocity: 3.0")
    with pytest.raises(
        SequenceError, match=r"^the robot refused the sequence: it asks for 4 m/s; at most 3 m/s is allowed$"
    ):
        LockstepCanSeat(None, limited).run("refused", single_segment(4.0, 0.0, 0.1))


def test_a_robot_that_leaves_a_manoeuvre_is_an_error_and_no_position(tmp_path: Path) -> None:
    trips = robot(tmp_path, "wheel_velocity_limit: 260.0", "wheel_velocity_limit: 10.0")
    with pytest.raises(RobotLostError, match=r"^the robot left the sequence; FAULT: "):
        LockstepCanSeat(None, trips).run("left", single_segment(4.0, 0.0, 0.5))


def test_a_robot_that_never_arms_is_an_error_and_not_waited_for_without_end(tmp_path: Path) -> None:
    never = robot(tmp_path, "arming: at_start", "arming: on_request")
    with pytest.raises(RobotLostError, match=r"cycles were asked for; DISARMED: "):
        LockstepCanSeat(None, never).run("never", single_segment(1.0, 0.0, 0.1))


def test_two_processes_in_real_time_end_where_the_model_does(tmp_path: Path) -> None:
    manoeuvre = single_segment(1.0, 0.5, 1.0)
    seat = RealTimeCanSeat(tmp_path, tmp_path)
    found = seat.run("real", manoeuvre).trajectory

    assert 0.0 < seat.timings["real"].lateness_p99_s <= seat.timings["real"].lateness_worst_s
    assert found.time == pytest.approx([0.01 * index for index in range(101)])
    close_to_offline(found, manoeuvre, tmp_path, 0.05)
    assert (tmp_path / "can_real.mcap").read_bytes().endswith(b"\x89MCAP0\r\n")


class RealTime(RealTimeCanSeat):
    """Runs in lock step, or fails as often as it is told to, with the machine stalled or not."""

    def __init__(self, folder: Path, failures: Sequence[RigError]) -> None:
        super().__init__(folder, folder)
        self._failures = iter(failures)

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        for failure in self._failures:
            raise failure
        self.timings[name] = LoopTiming(0.0001, 0.002, 3, 0.25)
        return LockstepCanSeat(None).run(name, manoeuvre)


def test_one_run_in_real_time_is_compared_with_lock_step(tmp_path: Path) -> None:
    found = run_in_real_time(RealTime(tmp_path, []), LockstepCanSeat(None), Repeats())

    assert (found.deviation_m, found.failure, found.is_spoiled) == (0.0, "", False)
    assert found.text == (
        "The can seat in real time (1 m/s, 0.5 rad/s, 5 s): at most 0.0000 m from lock step; lateness p99 0.10 ms, "
        "worst 2.00 ms; 3 deadlines skipped; the machine stalled for up to 250 ms meanwhile"
    )


SPOILED, BROKEN = SpoiledRunError("it tripped"), RigError("it broke")


@pytest.mark.parametrize(("failures", "is_spoiled"), [([SPOILED] * 3, True), ([SPOILED, BROKEN, SPOILED], False)])
def test_a_failure_is_the_machines_only_where_it_spoiled_each_try(
    tmp_path: Path, failures: list[RigError], is_spoiled: object
) -> None:
    repeats = Repeats()
    found = run_in_real_time(RealTime(tmp_path, failures), LockstepCanSeat(None), repeats)

    assert (found.timing, found.deviation_m, found.is_spoiled) == (None, None, is_spoiled)
    assert "no result. can in real time failed in each of 3 tries, the last time: it tripped" in found.text
    assert len(repeats.causes) == 2


def fails(code: int | None, late_s: float | None = None) -> ProcessFailedError:
    error = ProcessFailedError("it ended")
    error.ended_with = code
    error.printed = None if late_s is None else {"timing": {"lateness": {"max_s": late_s}}}
    return error


STALLED = Stalls(0.3)
RESTED = Stalls(0.3, 0.3, (0.01, 0.61))
CASES = {
    "tripped": (fails(7), STALLED, "cart-can", SpoiledRunError),
    "crowded": (fails(7), Stalls(0.01, 0.3), "cart-can", SpoiledRunError),
    "no stall": (fails(7), Stalls(0.01, 0.1), "cart-can", ProcessFailedError),
    "robot stopped": (fails(7, 0.6), RESTED, "cart-can", ProcessFailedError),
    "robot rested before it began": (fails(7, 0.1), RESTED, "cart-can", SpoiledRunError),
    "plant stopped": (fails(7, 0.01), Stalls(0.3, 0.3, (0.61, 0.01)), "cart-can", ProcessFailedError),
    "fails in lock step too": (fails(7), STALLED, "no-such-robot", ProcessFailedError),
    "another exit code": (fails(9), STALLED, "cart-can", ProcessFailedError),
    "hung": (fails(None), STALLED, "cart-can", ProcessFailedError),
    "another error": (RigError("it ended"), STALLED, "cart-can", RigError),
}


@pytest.mark.parametrize("case", CASES)
def test_a_stall_excuses_only_a_robot_that_gave_up_and_does_not_in_lock_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    error, stalls, robot, kind = CASES[case]
    monkeypatch.setattr(error, "args", error.args)

    def play(*_: object) -> None:
        raise error

    monkeypatch.setattr(can_seat, "witness", lambda _messages: contextlib.nullcontext(Seen(stalls)))
    monkeypatch.setattr(RealTimeCanSeat, "_play", play)
    with pytest.raises(RigError) as raised:
        RealTimeCanSeat(tmp_path, tmp_path, robot).run("fails", single_segment(1.0, 0.0, 0.1))

    assert type(raised.value) is kind
    assert str(raised.value).startswith("; ".join(filter(None, ("it ended", stalls.text))))
    assert ("stopped, or hung, for " in str(raised.value)) == ("stopped" in case)


def test_a_plant_that_has_ended_is_the_failure_and_not_the_robot_that_misses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Ended:
        def __init__(self, code: int) -> None:
            self.process = self
            self.pid = 0
            self.code = code

        def poll(self) -> int:
            return self.code

        def result(self, _timeout_s: float, _partner: object = None) -> None:
            raise fails(self.code)

    monkeypatch.setattr(
        can_seat, "command", lambda words, _messages: contextlib.nullcontext(Ended(2 if words[0] == "plant" else 7))
    )
    monkeypatch.setattr(can_seat, "witness", lambda _messages: contextlib.nullcontext(Seen()))
    with pytest.raises(ProcessFailedError) as raised:
        RealTimeCanSeat(tmp_path, tmp_path).run("fails", single_segment(1.0, 0.0, 0.1))

    assert raised.value.ended_with == 2


class Seen:
    """A witness of a machine that did not stall, or as given."""

    def __init__(self, stalls: Stalls = Stalls()) -> None:  # noqa: B008 - it is frozen
        self._stalls = stalls

    def watch(self, *processes: object) -> None:
        """Look at nobody."""

    def stalls(self) -> Stalls:
        return self._stalls


class Played:
    """Processes that record how they were called; the controller prints what it is given, or fails."""

    def __init__(self, found: "dict[str, object] | ProcessFailedError") -> None:
        self.found, self.process, self.pid, self.channels = found, self, 0, list[str]()

    def command(self, words: list[str], _messages: Path) -> "contextlib.nullcontext[Played]":
        self.channels.append(words[words.index("--channel") + 1])
        return contextlib.nullcontext(self)

    def poll(self) -> None:
        return None

    def result(self, _timeout_s: float, _partner: object) -> dict[str, object]:
        if isinstance(self.found, ProcessFailedError):
            raise self.found
        return self.found


@pytest.mark.parametrize(
    ("found", "kind"),
    [({"stop_reason": "SIGINT", "sequence": None}, KeyboardInterrupt), (fails(13), SequenceError)],
    ids=["interrupted", "refused"],
)
def test_a_robot_that_was_interrupted_or_refused_is_no_failure_to_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: "dict[str, object] | ProcessFailedError", kind: type
) -> None:
    played = Played(found)
    monkeypatch.setattr(can_seat, "command", played.command)
    monkeypatch.setattr(can_seat, "witness", lambda _messages: contextlib.nullcontext(Seen()))
    with pytest.raises(kind):
        RealTimeCanSeat(tmp_path, tmp_path).run("turn", single_segment(1.0, 0.0, 0.1))

    assert set(played.channels) == {f"case_study_{os.getpid()}_turn"}


def test_the_worst_of_a_table_in_real_time_is_of_all_its_runs(tmp_path: Path) -> None:
    seat = RealTimeCanSeat(tmp_path, tmp_path)
    seat.timings = {"one": LoopTiming(0.001, 0.002, 3, 0.0), "two": LoopTiming(0.0, 0.05, 1, 0.04)}

    assert seat.worst().timing == LoopTiming(0.001, 0.05, 4, 0.04)


def test_a_controller_that_fails_is_reported_with_its_messages(tmp_path: Path) -> None:
    # The controller's log cannot be written here.
    (tmp_path / "file").touch()
    with pytest.raises(RigError, match=r"ended with exit code 9: .*cannot write the log"):
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


def test_a_truth_that_ends_before_the_manoeuvre_is_not_drawn_out() -> None:
    ticks = [Odometry(ns * 1_000_000, 1.0, 0.0, 0.0, 0.0, 0.0) for ns in (0, 5, 10, 15)]

    assert len(can_seat.resample(ticks, 0, 20_000_000)) == 3
    for known in (ticks[:3], ticks[:1]):
        with pytest.raises(RigError, match="end before the manoeuvre"):
            can_seat.resample(known, 0, 20_000_000)


def test_a_point_on_a_tick_is_that_tick() -> None:
    ticks = [Odometry(ns, float(ns), 0.0, 0.0, 0.0, 0.0) for ns in (0, 10_000_000, 20_000_000)]

    found = can_seat.resample(ticks, 0, 20_000_000)
    assert [point.x for point in found] == [0.0, 10_000_000.0, 20_000_000.0]

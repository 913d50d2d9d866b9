# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.drives.vesc.condition import Found, Step, TimeoutProbe

MS = 1_000_000
TIMEOUT_S = 0.05
QUIET_MS = 50 + 25
"""The time-out, and time for the firmware to notice."""


class Bench:
    """A probe, stepped every 5 ms."""

    def __init__(self) -> None:
        self.now_ns = 7_000 * MS
        self.probe = TimeoutProbe(TIMEOUT_S)

    def found(self) -> Found:
        return self.probe.found

    def step(self) -> Step:
        step = self.probe.step(self.now_ns)
        self.now_ns += 5 * MS
        return step

    def steps(self, duration_ms: int) -> list[Step]:
        return [self.step() for _ in range(duration_ms // 5)]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_zero_then_silence_for_the_time_out_and_then_the_question(bench: Bench) -> None:
    assert bench.step() is Step.ZERO
    assert set(bench.steps(QUIET_MS - 5)) == {Step.NOTHING}
    assert bench.step() is Step.ASK
    assert bench.found() is Found.NOTHING


def test_the_answer_that_it_acted_ends_the_measurement(bench: Bench) -> None:
    bench.steps(QUIET_MS + 5)
    bench.probe.note_answer(timed_out=True, received_ns=bench.now_ns)
    assert bench.found() is Found.ACTS
    assert bench.probe.silence_s == pytest.approx(0.080)
    assert set(bench.steps(3_000)) == {Step.ZERO}


def test_an_answer_before_the_silence_is_over_means_nothing(bench: Bench) -> None:
    bench.probe.note_answer(timed_out=True, received_ns=bench.now_ns)
    bench.step()
    bench.probe.note_answer(timed_out=True, received_ns=bench.now_ns + (QUIET_MS - 6) * MS)
    assert bench.found() is Found.NOTHING
    assert bench.step() is Step.NOTHING


def test_the_answer_that_it_did_not_act_is_asked_again_and_then_believed(bench: Bench) -> None:
    bench.steps(QUIET_MS + 5)
    for _ in range(9):
        bench.probe.note_answer(timed_out=False, received_ns=bench.now_ns)
        assert bench.step() is Step.ASK
    assert bench.step() is Step.ZERO
    assert bench.found() is Found.DOES_NOT_ACT
    assert bench.probe.silence_s == pytest.approx(QUIET_MS * 1e-3 + 0.045)


def test_one_that_did_not_act_is_measured_again_after_a_second(bench: Bench) -> None:
    bench.steps(QUIET_MS + 5)
    bench.probe.note_answer(timed_out=False, received_ns=bench.now_ns)
    bench.steps(50)
    assert bench.found() is Found.DOES_NOT_ACT
    assert set(bench.steps(1_000)) == {Step.ZERO}
    bench.steps(QUIET_MS)
    bench.probe.note_answer(timed_out=True, received_ns=bench.now_ns)
    assert bench.found() is Found.ACTS


def test_one_late_answer_that_it_acted_is_enough(bench: Bench) -> None:
    bench.steps(QUIET_MS + 5)
    bench.probe.note_answer(timed_out=False, received_ns=bench.now_ns)
    bench.steps(10)
    bench.probe.note_answer(timed_out=True, received_ns=bench.now_ns)
    assert bench.found() is Found.ACTS


def test_three_tries_without_an_answer_end_the_measurement(bench: Bench) -> None:
    for times in range(1, 4):
        assert bench.found() is Found.NOTHING, times
        bench.steps(QUIET_MS + 50)
        if times == 2:
            bench.probe.note_answer(None, bench.now_ns)  # older firmware: an answer without the value
        assert bench.step() is Step.ZERO
    assert bench.found() is Found.NOT_REPORTED
    assert set(bench.steps(3_000)) == {Step.ZERO}


def test_a_command_in_between_begins_the_measurement_anew(bench: Bench) -> None:
    bench.steps(QUIET_MS)
    bench.probe.break_off()
    bench.probe.note_answer(timed_out=True, received_ns=bench.now_ns)
    assert bench.found() is Found.NOTHING
    assert bench.step() is Step.ZERO
    assert bench.step() is Step.NOTHING


def test_another_controller_is_measured_anew(bench: Bench) -> None:
    bench.steps(QUIET_MS + 5)
    bench.probe.note_answer(timed_out=True, received_ns=bench.now_ns)
    bench.probe.reset()
    assert bench.found() is Found.NOTHING
    assert bench.probe.silence_s == 0.0
    assert [bench.step(), bench.step()] == [Step.ZERO, Step.NOTHING]

# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.drives.cia402.wheel import Exchange, Restoring

MS = 1_000_000
WRITE = Exchange(bytes.fromhex("2b17100014000000"), bytes.fromhex("6017100000000000"))
READ = Exchange(bytes.fromhex("4017100000000000"), bytes.fromhex("4b17100014000000"))


class Bench:
    def __init__(self) -> None:
        self.now_ns = 5 * MS
        self.restoring = Restoring((WRITE, READ), lambda: self.now_ns)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_nothing_is_to_be_done_before_a_restart(bench: Bench) -> None:
    assert not bench.restoring.is_under_way
    assert bench.restoring.next_request() is None
    assert not bench.restoring.take_answer(WRITE.answer)


def test_requests_go_out_one_by_one_each_after_its_answer(bench: Bench) -> None:
    bench.restoring.begin()
    assert bench.restoring.next_request() == WRITE.request
    assert bench.restoring.next_request() is None
    assert bench.restoring.take_answer(WRITE.answer)
    assert not bench.restoring.take_answer(WRITE.answer)
    assert bench.restoring.next_request() == READ.request
    assert bench.restoring.take_answer(READ.answer)
    assert not bench.restoring.is_under_way
    assert bench.restoring.next_request() is None
    assert bench.restoring.failure is None


@pytest.mark.parametrize("frame", ["", "6018100000000000", "4b17100014000000", "8018100002000106", "0000000000000000"])
def test_a_frame_that_answers_something_else_is_no_answer(bench: Bench, frame: str) -> None:
    bench.restoring.begin()
    bench.restoring.next_request()
    assert not bench.restoring.take_answer(bytes.fromhex(frame))
    assert bench.restoring.failure is None
    assert bench.restoring.take_answer(WRITE.answer)


def test_a_write_that_is_answered_otherwise_has_failed(bench: Bench) -> None:
    bench.restoring.begin()
    bench.restoring.next_request()
    bench.restoring.take_answer(bytes.fromhex("8017100002000106"))
    assert bench.restoring.failure == "object 0x1017:00 is not answered as it was"
    assert not bench.restoring.is_under_way
    assert bench.restoring.next_request() is None


def test_a_read_is_repeated_until_it_reads_as_it_did_or_time_is_up(bench: Bench) -> None:
    bench.restoring.begin()
    bench.restoring.next_request()
    bench.restoring.take_answer(WRITE.answer)
    for _ in range(3):
        assert bench.restoring.next_request() == READ.request
        bench.restoring.take_answer(bytes.fromhex("4b17100000000000"))
        bench.now_ns += 100 * MS
    assert bench.restoring.next_request() == READ.request
    bench.now_ns += 1
    assert bench.restoring.next_request() is None
    assert bench.restoring.failure == "object 0x1017:00 is not answered as it was"


def test_silence_fails_after_three_tenths_of_a_second(bench: Bench) -> None:
    bench.restoring.begin()
    bench.restoring.next_request()
    bench.now_ns += 300 * MS
    bench.restoring.next_request()
    assert bench.restoring.failure is None
    bench.now_ns += 1
    bench.restoring.next_request()
    assert bench.restoring.failure is not None


def test_each_request_has_its_own_time(bench: Bench) -> None:
    bench.restoring.begin()
    bench.restoring.next_request()
    bench.now_ns += 200 * MS
    bench.restoring.take_answer(WRITE.answer)
    bench.restoring.next_request()
    bench.now_ns += 200 * MS
    assert bench.restoring.next_request() is None
    assert bench.restoring.failure is None


def test_another_restart_begins_anew_even_after_a_failure(bench: Bench) -> None:
    bench.restoring.begin()
    bench.restoring.next_request()
    bench.now_ns += 301 * MS
    bench.restoring.next_request()
    bench.restoring.begin()
    assert bench.restoring.failure is None
    assert bench.restoring.next_request() == WRITE.request
    bench.restoring.take_answer(WRITE.answer)
    bench.restoring.begin()
    assert bench.restoring.next_request() == WRITE.request

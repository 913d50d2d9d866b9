# SPDX-License-Identifier: MIT
"""What a model prints is logged with a limit, and the rest is counted."""

import fcntl
import os
import threading
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from segway_ecc.node.watchdog.output import AT_ONCE, COUNT_EVERY_S, PER_S, ModelOutput

PREFIX = "segway-ecc: model 'tank' printed: "
DUMP = b"""Fatal Python error: Segmentation fault

Thread 0x00007e (most recent call first):
  File "/home/me/other.py", line 7 in wait

Current thread 0x00007f (most recent call first):
  File "/home/me/tank.py", line 12 in output
  File "/opt/segway_ecc/node/cycle/cycle.py", line 3 in run
"""


@pytest.fixture
def end() -> SimpleNamespace:
    """Both ends of a pipe, what was written, and the time, s."""
    pipe, printed = os.pipe()
    return SimpleNamespace(pipe=pipe, printed=printed, lines=[], now_s=0.0)


@pytest.fixture
def output(end: SimpleNamespace) -> ModelOutput:
    return ModelOutput(end.pipe, end.lines.append, lambda: end.now_s, name="tank")


def lines(end: SimpleNamespace) -> list[str]:
    """What was logged, without what each line begins with."""
    return [line.removeprefix(PREFIX).rstrip("\n") for line in end.lines]


def test_each_line_names_the_model(output: ModelOutput, end: SimpleNamespace) -> None:
    output.take(b"one\ntw")
    output.take(b"o\n")
    assert end.lines == [f"{PREFIX}one\n", f"{PREFIX}two\n"]


def test_lines_beyond_the_limit_are_counted(output: ModelOutput, end: SimpleNamespace) -> None:
    output.take(b"x\n" * 1000)
    output.close(has_failed=False)
    assert lines(end) == ["x"] * AT_ONCE + [f"segway-ecc: model 'tank' printed {1000 - AT_ONCE} more lines"]


def test_a_second_brings_more_lines(output: ModelOutput, end: SimpleNamespace) -> None:
    output.take(b"x\n" * AT_ONCE)
    end.now_s = 3.0 / PER_S
    output.take(b"y\n" * 10)
    assert lines(end) == ["x"] * AT_ONCE + ["y"] * 3


def test_one_that_prints_for_hours_has_few_lines_in_the_log(output: ModelOutput, end: SimpleNamespace) -> None:
    for second in range(3600):
        end.now_s = float(second)
        output.take(b"x\n" * 100)
    assert len(lines(end)) <= AT_ONCE + 3600 * PER_S


def test_the_last_lines_before_a_failure_are_logged_in_any_case(output: ModelOutput, end: SimpleNamespace) -> None:
    output.take(b"".join(b"line %d\n" % number for number in range(100)))
    output.take(b"about to divide")
    output.close(has_failed=True)
    assert lines(end)[AT_ONCE:-1] == ["line 96", "line 97", "line 98", "line 99", "about to divide"]
    assert lines(end)[-1].endswith(f"printed {100 - AT_ONCE - 4} more lines")


@pytest.mark.parametrize("size", [1, 7, 4000])
def test_the_reason_of_an_end_by_a_signal_is_found_and_not_logged(
    output: ModelOutput, end: SimpleNamespace, size: int
) -> None:
    printed = b"about to read" + DUMP
    for at in range(0, len(printed), size):
        output.take(printed[at : at + size])
    output.close(has_failed=True)
    assert output.reason == "segmentation fault (/home/me/tank.py:12)"
    assert lines(end) == ["about to read"]


def test_the_reason_is_found_where_only_one_thread_is_reported(output: ModelOutput) -> None:
    output.take(b'Fatal Python error: Aborted\n\nStack (most recent call first):\n  File "tank.py", line 3 in output\n')
    assert output.reason == "aborted (tank.py:3)"


def test_native_code_has_no_line(output: ModelOutput) -> None:
    output.take(DUMP.replace(b"/home/me/tank.py", b"/opt/segway_ecc/node/native/library.py"))
    assert output.reason == "segmentation fault"


def test_a_model_that_prints_as_a_crash_does_is_logged_all_the_same(output: ModelOutput, end: SimpleNamespace) -> None:
    output.take(b"Fatal Python error: not at all\nmore\n")
    output.close(has_failed=False)
    assert lines(end) == ["Fatal Python error: not at all", "more"]


def test_what_a_terminal_would_obey_is_shown_as_question_marks(output: ModelOutput, end: SimpleNamespace) -> None:
    output.take(b"\x1b[2Jred\x07 \xff\n" + b"y" * 1000 + b"\n")
    assert lines(end) == ["?[2Jred? \ufffd", "y" * 300 + " ..."]


def test_a_line_without_an_end_takes_no_more_memory(output: ModelOutput, end: SimpleNamespace) -> None:
    for _ in range(1000):
        output.take(b"z" * 1000)
    assert len(lines(end)) == AT_ONCE
    assert len(output._partial) <= 4096


def run_in_thread(output: ModelOutput) -> Callable[[], None]:
    thread = threading.Thread(target=output.run, daemon=True)
    thread.start()

    def finish() -> None:
        output.finish(10.0)
        thread.join(10.0)
        assert not thread.is_alive()

    return finish


def test_what_is_left_in_the_pipe_at_the_end_is_read(output: ModelOutput, end: SimpleNamespace) -> None:
    finish = run_in_thread(output)
    for number in range(5):
        os.write(end.printed, b"line %d\n" % number)
    finish()
    assert lines(end) == [f"line {number}" for number in range(5)]


def test_a_pipe_that_nobody_writes_to_any_more_is_waited_for(output: ModelOutput, end: SimpleNamespace) -> None:
    os.write(end.printed, b"last\n")
    os.close(end.printed)
    run_in_thread(output)()
    assert lines(end) == ["last"]


def test_what_found_no_room_is_reported(output: ModelOutput, end: SimpleNamespace) -> None:
    os.set_blocking(end.printed, False)
    size = fcntl.fcntl(end.pipe, fcntl.F_GETPIPE_SZ)
    os.write(end.printed, (b"x" * 63 + b"\n") * (size // 64))
    run_in_thread(output)()
    output.close(has_failed=False)
    assert lines(end)[-1].endswith(f"printed {size // 64 - AT_ONCE} more lines, and more that was lost")


def test_the_count_comes_while_it_goes_on(output: ModelOutput, end: SimpleNamespace) -> None:
    output.take(b"x\n" * 100)
    end.now_s = COUNT_EVERY_S
    run_in_thread(output)()
    assert lines(end)[-1].endswith("printed 80 more lines")

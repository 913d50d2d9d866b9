# SPDX-License-Identifier: MIT
import io
import logging
import sys
import threading

import pytest

from segway_ecc.node.logs import messages, messages_to


def lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err.splitlines()


def test_notices_and_warnings_go_to_standard_error_in_order_under_our_name(capsys: pytest.CaptureFixture[str]) -> None:
    with messages():
        logging.getLogger("segway_ecc.node.anything").info("robot '%s' runs", "cart")
        logging.getLogger("elsewhere").warning("it is warm")

    assert lines(capsys) == ["segway-ecc: robot 'cart' runs", "segway-ecc: it is warm"]


def test_details_are_not_shown(capsys: pytest.CaptureFixture[str]) -> None:
    with messages():
        logging.getLogger("segway_ecc.node.anything").debug("a detail")

    assert lines(capsys) == []


def test_python_can_logs_errors_only(capsys: pytest.CaptureFixture[str]) -> None:
    with messages():
        logging.getLogger("can.interfaces").warning("something python-can finds remarkable")
        logging.getLogger("can.interfaces").error("something broke")

    assert lines(capsys) == ["segway-ecc: something broke"]


def test_every_message_is_written_before_the_context_ends(capsys: pytest.CaptureFixture[str]) -> None:
    with messages():
        for number in range(1000):
            logging.getLogger("segway_ecc.node").info("%d", number)

    assert lines(capsys) == [f"segway-ecc: {number}" for number in range(1000)]


def test_an_error_on_the_way_out_loses_no_message(capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        with messages():
            logging.getLogger("segway_ecc.node").info("just before")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()

    assert lines(capsys) == ["segway-ecc: just before"]


def test_the_root_logger_is_left_as_it_was(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)
    root = logging.getLogger()
    before, threads = (root.level, list(root.handlers)), set(threading.enumerate())
    with messages():
        assert root.level == logging.INFO
        assert len(root.handlers) == len(before[1]) + 1

    assert (root.level, list(root.handlers)) == before
    assert set(threading.enumerate()) <= threads  # those of other tests may end meanwhile


def test_contexts_can_follow_one_another(capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(2):
        with messages():
            logging.getLogger("segway_ecc.node").info("%d", number)

    assert lines(capsys) == ["segway-ecc: 0", "segway-ecc: 1"]


class Stuck(io.StringIO):
    """A terminal that takes nothing until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.reached, self.let_go = threading.Event(), threading.Event()

    def write(self, text: str, /) -> int:
        self.reached.set()
        assert self.let_go.wait(60.0)
        return super().write(text)


def test_a_terminal_that_takes_nothing_does_not_hold_up_who_speaks(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Stuck()
    monkeypatch.setattr(sys, "stderr", terminal)
    with messages():
        logging.getLogger("segway_ecc.node").warning("first")
        assert terminal.reached.wait(60.0)
        # Were the messages written here, this would not come back.
        for number in range(100):
            logging.getLogger("segway_ecc.node").warning("%d", number)
        terminal.let_go.set()

    assert terminal.getvalue().splitlines() == ["segway-ecc: first", *(f"segway-ecc: {n}" for n in range(100))]


class Kept(logging.Handler):
    """Keeps what is said."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


def test_messages_can_go_elsewhere(capsys: pytest.CaptureFixture[str]) -> None:
    kept, root = Kept(), logging.getLogger()
    before = (root.level, list(root.handlers))
    with messages_to(kept):
        logging.getLogger("segway_ecc.node").debug("a detail")
        logging.getLogger("segway_ecc.node").info("it is %s", "warm")
        logging.getLogger("can.interfaces").warning("something python-can finds remarkable")
    logging.getLogger("segway_ecc.node").warning("too late")

    assert kept.said == ["it is warm"]
    assert lines(capsys) == []
    assert (root.level, list(root.handlers)) == before


def test_an_error_gives_the_root_logger_back() -> None:
    kept, root = Kept(), logging.getLogger()
    with pytest.raises(ZeroDivisionError), messages_to(kept):
        raise ZeroDivisionError
    assert kept not in root.handlers

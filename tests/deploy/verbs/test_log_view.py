# SPDX-License-Identifier: MIT
"""`segway-ecc log view`: serves the page that plays a log, and refuses in one line what it cannot."""

import os
import signal
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command import Outcome
from tests.deploy.station.playback.log_maker import story, write_log

SegwayEcc = Callable[..., Outcome]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(tmp_path / "run.mcap", story(2.0))


def test_page_is_served_until_a_signal(segway_ecc: SegwayEcc, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    def open_page(address: str) -> bool:
        opened.append(address)
        os.kill(os.getpid(), signal.SIGTERM)
        return True

    monkeypatch.setattr("webbrowser.open", open_page)
    outcome = segway_ecc("log", "view", str(log), "--port", "0", "--at", "1.5", "--browser")
    assert (outcome.code, outcome.out) == (0, "ended by  SIGTERM\n")
    (address,) = opened
    assert address.startswith("http://127.0.0.1:")
    assert address.endswith("/log#log=run.mcap&t=1.5")
    assert outcome.errors == [f"segway-ecc: the page is open: {address}; Ctrl-C ends it"]
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address)  # noqa: S310 - our own address


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["{log}", "--port", "70000"], 2, "--port is 0 to 65535"),
        (["{log}", "--at", "-1"], 2, "--at is 0 to 1e+07 s"),
        (["{log}", "--at", "nan"], 2, "nan is not finite"),
        (["{folder}/nothing.mcap"], 9, "nothing.mcap: No such file or directory"),
        (["{folder}"], 9, "it is no file"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_line(
    segway_ecc: SegwayEcc, log: Path, words: list[str], code: int, message: str
) -> None:
    outcome = segway_ecc("log", "view", *(word.format(log=log, folder=log.parent) for word in words))
    assert (outcome.code, outcome.out) == (code, "")
    (line,) = outcome.errors
    assert message in line

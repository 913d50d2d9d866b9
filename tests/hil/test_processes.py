# SPDX-License-Identifier: MIT
"""Commands as processes: what is told when one fails, and that none is left behind."""

import os
import signal
import sys
from pathlib import Path

import pytest

from segway_ecc.hil import processes
from segway_ecc.hil.processes import ProcessFailedError, command
from segway_ecc.node.config import packaged_robots
from tests.patience import PATIENCE_S

RUNS_FOR_EVER = ("run", "cart", "--no-ros", "--no-log", "--json")


def is_gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_what_a_command_prints_is_its_result(tmp_path: Path) -> None:
    with command([*RUNS_FOR_EVER, "--duration", "0.05"], tmp_path / "messages.txt") as started:
        result = started.result(PATIENCE_S)

    assert result["cycles"] == 5
    assert "segway-ecc: ARMED: asked to arm" in (tmp_path / "messages.txt").read_text().splitlines()


def test_a_command_that_fails_is_reported_in_one_line_with_its_messages(tmp_path: Path) -> None:
    with (
        command(["run", "no such robot"], tmp_path / "messages.txt") as started,
        pytest.raises(ProcessFailedError) as caught,
    ):
        started.result(PATIENCE_S)

    assert str(caught.value) == (
        "'segway-ecc run no such robot' ended with exit code 2: segway-ecc: cannot read robot file 'no such robot': "
        f"No such file or directory; the packaged robots are {', '.join(packaged_robots())}"
    )


def test_only_the_last_messages_are_reported(tmp_path: Path) -> None:
    with command(["--version"], tmp_path / "messages.txt") as started:
        started.end()
    (tmp_path / "messages.txt").write_bytes(b"\n".join(b"line %d \xff" % number for number in range(8)))

    assert started._failure("fell").endswith(
        "fell: line 3 \N{REPLACEMENT CHARACTER} | line 4 \N{REPLACEMENT CHARACTER} | "
        "line 5 \N{REPLACEMENT CHARACTER} | line 6 \N{REPLACEMENT CHARACTER} | line 7 \N{REPLACEMENT CHARACTER}"
    )


def test_a_command_that_is_killed_is_reported(tmp_path: Path) -> None:
    with command(RUNS_FOR_EVER, tmp_path / "messages.txt") as started:
        started.process.kill()
        with pytest.raises(ProcessFailedError, match=r"ended with exit code -9: (no message|segway-ecc: )"):
            started.result(PATIENCE_S)


@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_is_interrupted_is_an_interruption_and_no_failure(
    tmp_path: Path, ended_by: signal.Signals
) -> None:
    words = [sys.executable, "-c", f"import os; os.kill(os.getpid(), {int(ended_by)})"]
    with processes.program(words, tmp_path / "messages.txt") as started, pytest.raises(KeyboardInterrupt):
        started.result(PATIENCE_S)


def test_a_command_is_not_waited_for_whose_partner_failed(tmp_path: Path) -> None:
    with (
        command(RUNS_FOR_EVER, tmp_path / "messages.txt") as started,
        command(["run", "no such robot"], tmp_path / "partner.txt") as partner,
        pytest.raises(ProcessFailedError, match=r"^'segway-ecc run no such robot' ended with exit code 2: "),
    ):
        started.result(PATIENCE_S, partner)


def test_a_command_that_takes_too_long_is_reported_and_ended(tmp_path: Path) -> None:
    with command(RUNS_FOR_EVER, tmp_path / "messages.txt") as started:
        with pytest.raises(ProcessFailedError, match=r"^'segway-ecc run cart .*' did not end within 0\.01 s: "):
            started.result(0.01)
        assert started.process.poll() is None

    assert is_gone(started.process.pid)


def test_a_command_is_ended_when_what_goes_on_meanwhile_fails(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), command(RUNS_FOR_EVER, tmp_path / "messages.txt") as started:
        raise ZeroDivisionError

    assert is_gone(started.process.pid)


def test_a_command_is_asked_to_end_before_it_is_killed(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    text = tmp_path / "messages.txt"
    with command(["run", "cart", "--no-ros", "--log", str(log)], text) as started:
        while "ARMED" not in text.read_text():
            assert started.process.poll() is None
    # MCAP files end with their magic bytes, once they are finished.
    assert log.read_bytes().endswith(b"\x89MCAP0\r\n")
    assert started.process.returncode == 0


def test_a_command_that_does_not_end_when_asked_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_END_S", 0.01)
    with command(RUNS_FOR_EVER, tmp_path / "messages.txt") as started:
        started.process.send_signal(signal.SIGSTOP)
        os.waitpid(started.process.pid, os.WUNTRACED)

    assert started.process.returncode == -signal.SIGKILL


def test_the_environment_is_added_to_our_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # An interpreter that only tells its environment stands in for ours.
    script = tmp_path / "python"
    script.write_text(f"#!{sys.executable}\nimport json, os\nprint(json.dumps(dict(os.environ)))\n", "utf-8")
    script.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(script))
    monkeypatch.setenv("OURS", "kept")
    with command([], tmp_path / "messages.txt", {"THEIRS": "added"}) as started:
        result = started.result(PATIENCE_S)

    assert (result["OURS"], result["THEIRS"]) == ("kept", "added")


def test_a_command_that_listens_answers_line_by_line(tmp_path: Path) -> None:
    words = ["plant", "cart-can", "--interface", "local", "--channel", f"ask_{os.getpid()}", "--control"]
    with command(words, tmp_path / "messages.txt", listens=True) as started:
        answers = [started.ask(line, PATIENCE_S) for line in ("mute", "nonsense", "heal")]
        started.process.kill()
        started.process.wait()
        with pytest.raises(ProcessFailedError, match=r"did not answer 'mute': segway-ecc: plant of 'cart-can'"):
            started.ask("mute", PATIENCE_S)

    stamps, texts = zip(*(answer.split(" ", 1) for answer in answers), strict=True)
    assert texts[0] == "mute"
    assert texts[1].startswith("refused: ")
    assert texts[2] == "heal"
    assert sorted(map(int, stamps)) == [int(stamp) for stamp in stamps]


def test_answers_that_come_together_are_returned_one_by_one_and_one_that_does_not_come_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "python"
    script.write_text("#!/bin/sh\nread line\necho one; echo two; echo -n thr\nread line\nread line\n", "utf-8")
    script.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(script))
    with command([], tmp_path / "messages.txt", listens=True) as started:
        assert [started.ask("a", PATIENCE_S), started.ask("b", PATIENCE_S)] == ["one", "two"]
        with pytest.raises(ProcessFailedError, match=r"did not answer 'c': no message"):
            started.ask("c", 0.05)


def test_a_command_that_does_not_listen_cannot_be_asked(tmp_path: Path) -> None:
    with command(RUNS_FOR_EVER, tmp_path / "messages.txt") as started, pytest.raises(ValueError, match="not listen"):
        started.ask("mute", 0.01)


def test_another_module_can_stand_around_our_command(tmp_path: Path) -> None:
    words = [*RUNS_FOR_EVER, "--duration", "0.05"]
    with command(words, tmp_path / "messages.txt", module="segway_ecc.hil.drill.stepped_clock") as started:
        assert started.result(PATIENCE_S)["cycles"] == 5
        assert "segway_ecc.hil.drill.stepped_clock" in started.process.args  # type: ignore[operator]  # it is a list

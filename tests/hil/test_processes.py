"""Commands as processes: what is told when one fails, and that none is left behind."""

import os
import signal
import sys
from pathlib import Path

import pytest

from hil import processes
from hil.processes import ProcessFailedError, command

RUNS_FOR_EVER = ("run", "cart", "--no-ros", "--no-log", "--json")
ENDS_WITHIN_S = 30.0


def is_gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_what_a_command_prints_is_its_result(tmp_path: Path) -> None:
    with command([*RUNS_FOR_EVER, "--duration", "0.05"], tmp_path / "messages.txt") as started:
        result = started.result(ENDS_WITHIN_S)

    assert result["cycles"] == 5
    assert "segway-ecc: ARMED: asked to arm" in (tmp_path / "messages.txt").read_text().splitlines()


def test_a_command_that_fails_is_told_in_one_line_with_its_messages(tmp_path: Path) -> None:
    with (
        command(["run", "no such robot"], tmp_path / "messages.txt") as started,
        pytest.raises(ProcessFailedError) as caught,
    ):
        started.result(ENDS_WITHIN_S)

    assert str(caught.value) == (
        "'segway-ecc run no such robot' ended with exit code 2: segway-ecc: cannot read robot file 'no such robot': "
        "No such file or directory; the packaged robots are cart, cart-can, cart-cia402, cart-odrive, cart-vesc"
    )


def test_only_the_last_messages_are_told(tmp_path: Path) -> None:
    started = processes.Command(["--version"], tmp_path / "messages.txt", {})
    started.end()
    (tmp_path / "messages.txt").write_bytes(b"\n".join(b"line %d \xff" % number for number in range(8)))

    assert started._failure("fell").endswith(
        "fell: line 3 \N{REPLACEMENT CHARACTER} | line 4 \N{REPLACEMENT CHARACTER} | "
        "line 5 \N{REPLACEMENT CHARACTER} | line 6 \N{REPLACEMENT CHARACTER} | line 7 \N{REPLACEMENT CHARACTER}"
    )


def test_a_command_that_is_killed_is_told(tmp_path: Path) -> None:
    with command(RUNS_FOR_EVER, tmp_path / "messages.txt") as started:
        started.process.kill()
        with pytest.raises(ProcessFailedError, match=r"ended with exit code -9: (it said nothing|segway-ecc: )"):
            started.result(ENDS_WITHIN_S)


def test_a_command_that_takes_too_long_is_told_and_ended(tmp_path: Path) -> None:
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
        result = started.result(ENDS_WITHIN_S)

    assert (result["OURS"], result["THEIRS"]) == ("kept", "added")

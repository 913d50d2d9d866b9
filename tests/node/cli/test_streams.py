# SPDX-License-Identifier: MIT
"""Standard streams that are full, closed or broken, and what libraries write to them."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.node.config import read_text

RUNS = "run cart --no-ros --no-log --duration 0.02 --json"
FAILS = "run no-such-robot"


def shell(words: str, redirected: str) -> "subprocess.CompletedProcess[str]":
    command = f"{shlex.quote(sys.executable)} -P -m segway_ecc.node.cli.main {words} {redirected}"
    return subprocess.run(["/bin/bash", "-c", command], check=False, capture_output=True, text=True)


def reported(ended: "subprocess.CompletedProcess[str]") -> list[str]:
    lines = ended.stderr.splitlines()
    return [line for line in lines if "standard output" in line or not line.startswith("segway-ecc")]


@pytest.mark.parametrize(
    ("redirected", "reason"), [(">/dev/full", "No space left on device"), (">&-", "Bad file descriptor")]
)
@pytest.mark.parametrize("words", [RUNS, "--version", "run --help"])
def test_output_that_cannot_be_written_is_one_line_and_exit_code_1(words: str, redirected: str, reason: str) -> None:
    ended = shell(words, redirected)

    assert ended.returncode == 1
    assert reported(ended) == [f"segway-ecc: cannot write to standard output: {reason}"]


@pytest.mark.parametrize("redirected", ["2> >(:)", "2>&-", "2>/dev/full", ">&- 2>&-"])
def test_messages_that_cannot_be_written_leave_the_exit_code_as_it_is(redirected: str) -> None:
    assert shell(FAILS, redirected).returncode == 2
    assert shell("frobnicate", redirected).returncode == 2


@pytest.mark.parametrize("redirected", ["2> >(:)", "2>&-", "2>/dev/full"])
def test_output_is_whole_where_only_messages_cannot_be_written(redirected: str) -> None:
    ended = shell(RUNS, redirected)

    assert ended.returncode == 0
    assert json.loads(ended.stdout)["cycles"] == 2


def test_the_verbs_own_exit_code_comes_before_that_of_a_full_output() -> None:
    assert shell(FAILS, ">/dev/full").returncode == 2


def test_output_that_a_verb_itself_cannot_flush_is_reported_once(tmp_path: Path) -> None:
    ended = shell(f"case-study --seat offline --out {shlex.quote(str(tmp_path))}", ">/dev/full")

    assert ended.returncode == 1
    assert ended.stderr.count("cannot write to standard output") == 1


NOISY = """
import ctypes
from segway_ecc.node.models.cart import Cart
ctypes.CDLL(None).puts(b"noise")
print("more noise", file=__import__("sys").__stdout__)
print("and more")
"""


def test_what_a_library_prints_is_a_message_and_not_in_the_output(tmp_path: Path) -> None:
    (tmp_path / "noisy.py").write_text(NOISY)
    robot = tmp_path / "robot.yaml"
    robot.write_text(read_text("cart").replace("segway_ecc.node.models.cart:Cart", "noisy:Cart"))
    ended = shell(RUNS.replace("cart", shlex.quote(str(robot))), "")

    assert json.loads(ended.stdout)["cycles"] == 2
    printed = [
        line.rpartition(" printed: ")[2] for line in ended.stderr.splitlines() if line.startswith("segway-ecc: model")
    ]
    assert sorted(printed) == ["and more", "more noise", "noise"]


def test_a_text_that_no_encoding_has_is_printed_with_an_escape() -> None:
    code = (
        "import sys; from segway_ecc.node.cli.streams import claim_streams, flush_output; claim_streams();"
        "sys.stdout.write('half \\ud800 of a pair'); sys.stderr.write('\\udcff'); flush_output()"
    )
    ended = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert (ended.stdout, ended.stderr) == ("half \\ud800 of a pair", "\\udcff")

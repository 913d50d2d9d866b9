# SPDX-License-Identifier: MIT
"""Processes that help the loop; that they start, are told and end is shown where each is."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.node.helper import spawn_helper
from tests.open_files import open_files


@pytest.mark.parametrize("module", ["segway_ecc.node.recording.writer", "segway_ecc.node.ros.process"])
def test_a_helper_imports_nothing_of_what_starts_one(module: str) -> None:
    program = f"import sys; import {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert module in done.stdout.split()
    assert not {"segway_ecc.node.helper", "subprocess"} & set(done.stdout.split())


def test_a_spawned_helper_reads_writes_and_has_the_files_and_a_session_of_its_own() -> None:
    memory = os.memfd_create("shared")
    os.write(memory, b'{"a": 1}')
    pid, source, sink = spawn_helper("json.tool", (memory,))
    with source, sink:
        assert os.getsid(pid) == pid
        assert Path(f"/proc/{pid}/fd/{memory}").samefile(f"/proc/self/fd/{memory}")
        source.write(b'{"b": 2}')
        source.close()
        assert sink.read() == b'{\n    "b": 2\n}\n'
    assert os.waitpid(pid, 0)[1] == 0
    os.close(memory)


def test_a_helper_that_cannot_be_spawned_is_an_error_and_leaves_no_file_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    before = open_files()
    with pytest.raises(FileNotFoundError):
        spawn_helper("json.tool", ())
    assert open_files() <= before

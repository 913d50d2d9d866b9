# SPDX-License-Identifier: MIT
"""Processes that help the loop; that they start, are told and end is shown where each is."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["segway_ecc.node.recording.writer", "segway_ecc.node.ros.process"])
def test_a_helper_imports_nothing_of_what_starts_one(module: str) -> None:
    program = f"import sys; import {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert module in done.stdout.split()
    assert not {"segway_ecc.node.helper", "subprocess"} & set(done.stdout.split())

# SPDX-License-Identifier: MIT
"""A robot file whose model ends the process; see tests/deploy/doctor/test_robot_file.py for all else."""

import signal
import subprocess
import sys
from pathlib import Path

MODEL = """
import ctypes
from segway_ecc import Method, SectionedModel, Variable

class Tank(SectionedModel):
    name, step_size, method = "Tank", 0.01, Method.DISCRETE
    inputs, outputs = (Variable("inflow", "1", 1.5),), (Variable("level"),)

    def output(self):
        print("a line of the model")
        ctypes.string_at(0)
"""
ROBOT = """
name: tank
model: {source: "tank:Tank"}
wiring: {inflow: setpoint.linear_velocity, level: odometry.x}
"""


def test_a_model_that_crashes_is_named_with_its_cause(tmp_path: Path) -> None:
    (tmp_path / "tank.py").write_text(MODEL, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(ROBOT, encoding="utf-8")
    command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "deploy", "check", "robot.yaml", "--json"]
    done = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (-signal.SIGSEGV, "")
    assert "printed: a line of the model" in done.stderr
    assert "model 'Tank' failed in its initial equations" in done.stderr
    assert "segmentation fault" in done.stderr

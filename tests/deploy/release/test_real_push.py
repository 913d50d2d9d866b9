# SPDX-License-Identifier: MIT
"""This project itself, with all it needs, onto a robot that has no internet: wheel, numpy and the rest, over ssh."""

import os
import subprocess
import time

import pytest

from segway_ecc.deploy.release.agent.store import ReleaseManifest
from segway_ecc.node.cli.main import main
from tests.deploy.release.robot import Robot, Sshd


@pytest.mark.proof
def test_this_project_is_pushed_and_pushed_again(
    module_robot: Robot, sshd: Sshd, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--ssh-config", str(sshd.config), "--root", str(module_robot.root), "--config", str(module_robot.config)]
    words = ["deploy", "push", "robot", *where, "--ros", "none", "--trial", "0.1", "--start", "5", "--json"]
    began_s = time.monotonic()
    assert main([*words, "--robot", "segway"]) == 0, capsys.readouterr().err
    took_s = time.monotonic() - began_s
    module_robot.check_works()
    command = module_robot.root / "current" / "venv" / "bin" / "segway-ecc"
    run = [str(command), "run", str(module_robot.config / "robot.yaml"), "--no-ros", "--no-log", "--duration", "1"]
    done = subprocess.run(run, capture_output=True, text=True, check=False, cwd="/", env={"PATH": "/usr/bin:/bin"})
    assert done.returncode == 0, done.stderr
    # Other content, nearly the same wheels: only what differs is sent.
    assert main([*words, "--robot", "segway-odrive"]) == 0, capsys.readouterr().err
    module_robot.check_works()
    store = module_robot.store
    size = sum(entry.size for entry in (store.manifest(str(store.current())) or ReleaseManifest("")).files.values())
    with capsys.disabled():
        print(f"\nfirst push {took_s:.1f} s; a release is {size / 1e6:.0f} MB, load {os.getloadavg()[0]:.0f}")  # noqa: T201

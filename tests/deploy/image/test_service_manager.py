# SPDX-License-Identifier: MIT
"""`systemctl stop` of the unit as it is shipped, by a real systemd, while the segway balances: it sits down first.

In the image under user-mode Linux a segway does not balance: its one processor is too slow for 200 Hz beside the plant.
"""

import os
from pathlib import Path

import pytest

from segway_ecc.hil.drill.plant_control import read_trace
from segway_ecc.hil.processes import command
from segway_ecc.node.config import read_text
from tests.deploy.image.service_manager import NODE, lacking, service_manager

pytestmark = [pytest.mark.image, pytest.mark.systemd]
ROBOTS = ("segway", "segway-odrive")
STARTS_WITHIN_S = 60.0
ORDER = ("BALANCING", "SITTING DOWN", "stopped: SIGTERM")


@pytest.mark.skipif(lacking() is not None, reason=f"needs a service manager of its own: {lacking()}")
@pytest.mark.parametrize("robot", ROBOTS)
def test_robot_that_balances_sits_down_and_disarms_when_its_unit_is_stopped(robot: str, tmp_path: Path) -> None:
    bus = ("--interface", "local", "--channel", f"unit_{os.getpid()}_{robot}")
    trace = tmp_path / "trace.csv"
    words = ("plant", robot, *bus, "--control", "--trace", str(trace))
    with (
        command(words, tmp_path / "plant.txt", listens=True) as plant,
        service_manager(read_text(robot), " ".join(bus), tmp_path) as manager,
    ):
        plant.ask("heal", STARTS_WITHIN_S)  # it answers once it runs
        manager.systemctl("start", "segway-ecc-guard.service", NODE)
        manager.wait_for("BALANCING")
        manager.systemctl("stop", NODE)
        lines, driven = manager.lines(), [tick.is_driven for tick in read_trace(trace)]
        result = [manager.property(name) for name in ("Result", "ExecMainCode", "ExecMainStatus", "NRestarts")]
    assert result == ["success", "1", "0", "0"], lines
    places = [next(n for n, line in enumerate(lines) if text in line) for text in ORDER]
    assert places == sorted(places), lines
    assert not any("FAULT" in line for line in lines), lines
    assert True in driven
    assert not any(driven[-5:]), "the motors are off before the node has ended"

# SPDX-License-Identifier: MIT
"""The image on a real init system: it comes up by itself, and comes back whatever happens to it.

Times are printed and none is asserted: a guest is as fast as the machine that it runs on. What takes a plant
as well, and minutes, is in test_boot_proof.py.
"""

from pathlib import Path

import pytest

from tests.deploy.image.boot_report import analysis, boot_of
from tests.deploy.image.robot import Robot, SwitchOn
from tests.deploy.image.uml_machine import Machine

pytestmark = pytest.mark.image
WRITE = "dd if=/dev/urandom of=/var/lib/segway-ecc/written bs=64k count=4000 2> /dev/null & sleep 0.2"


def test_the_robot_comes_up_by_itself_comes_back_and_boots_again_after_its_power_was_cut(
    switch_on: SwitchOn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with switch_on(tmp_path / "first") as machine:
        robot = Robot(machine)
        robot.is_patient()
        robot.wait_until_up()
        looks_as_it_should(machine, robot)
        boot, analyzed = boot_of(robot), analysis(robot)
        assert boot.kernel < boot.init < boot.queued < boot.first_cycle < boot.ready
        assert "segway-ecc-node.service" in analyzed
        robot.mask_guard()
        robot.kill("SIGKILL")
        robot.wait_until_up()
        assert robot.status()["mode"] == "DISARMED"
        robot.kill("SIGSTOP")
        robot.wait_until_up()
        assert "Watchdog timeout" in robot.journal()
        ends_by_its_service_manager(robot)
        times, before = robot.times(), set(robot.logs())
        machine.run(WRITE)
    with switch_on(tmp_path / "second") as machine:
        robot = Robot(machine)
        robot.is_patient()
        robot.wait_until_up()
        assert len(before) >= 3, "one of each run"
        assert before < set(robot.logs()), "those of before the cut, and a new one"
        assert machine.run("ls /etc/ssh/ssh_host_*_key").strip() == "/etc/ssh/ssh_host_ed25519_key"
    with capsys.disabled():
        shown = f"{boot.text()}\n{analyzed}\n{times}"
        print(f"\nimage under user-mode Linux: {shown}")  # noqa: T201 - figures are for people


def ends_by_its_service_manager(robot: Robot) -> None:
    """With status 0, of which the kernel asks the model's watchdog, and not killed after its time to end."""
    robot.stop()
    assert robot.property("Result") == "success"
    assert (robot.property("ExecMainCode"), robot.property("ExecMainStatus")) == ("1", "0"), "CLD_EXITED, with 0"
    assert "stopped: SIGTERM" in robot.journal()
    robot.start()
    robot.wait_until_up()


def looks_as_it_should(machine: Machine, robot: Robot) -> None:
    assert robot.status()["mode"] == "DISARMED"
    assert machine.run("cat /proc/sys/kernel/hostname").strip() == "robot-under-test"
    assert machine.run("systemctl --failed --no-legend --plain").strip() == ""
    assert robot.property("ActiveState", "segway-ecc-guard.service") == "active"
    assert "configured" in machine.run("networkctl --no-pager status vcan0 | grep State")
    assert "qlen 64" in machine.run("ip link show vcan0")
    assert " ro," in machine.run("grep ' / ext4 ' /proc/mounts")
    node = robot.property("MainPID")
    # Fields 40 and 41 of proc(5), after the name: real-time priority and policy; 1 is SCHED_FIFO.
    assert machine.run(f"sed 's/.*) //' /proc/{node}/stat | cut -d' ' -f38,39").split() == ["50", "1"]
    assert int(machine.run(f"grep VmLck /proc/{node}/status").split()[1]) > 0
    found = machine.run(f"grep -E 'Cap(Prm|Eff|Bnd)' /proc/{node}/status | tr -d '0[:space:]'")
    assert found == "CapPrm:CapEff:CapBnd:", "it runs without any privilege"
    assert machine.run(f"stat -c %U /proc/{node}").strip() == "segway"

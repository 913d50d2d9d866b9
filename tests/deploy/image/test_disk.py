# SPDX-License-Identifier: MIT
"""The bootable disk with ROS in QEMU: it comes up by itself, and takes updates from this host over the network.

Nothing here is a real time: the machine is emulated. The robot's loop runs at 5 Hz, which it can keep.
"""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.node.cli.main import main
from tests.deploy.image.disk_machine import SLOW_ROBOT, DiskMachine, load, own_disk, switched_on
from tests.deploy.image.robot import NODE

pytestmark = [pytest.mark.image, pytest.mark.proof, pytest.mark.rt_kernel, pytest.mark.timeout(7200)]
WENT_BACK = 12
ROBOT = "/etc/segway-ecc/robot.yaml"
# The watchdog is for a machine that has the time, and the guard takes a quarter of this one.
UNWATCHED = f"""mkdir -p /run/systemd/system/{NODE}.d
printf '[Service]\\nTimeoutStartSec=infinity\\nWatchdogSec=0\\n' > /run/systemd/system/{NODE}.d/test.conf
systemctl daemon-reload; systemctl mask --quiet --runtime --now segway-ecc-guard"""
BREAKS = (
    "    count = 0\n\n    def output(self):\n        self.count += 1\n        1 / (self.count < 20)\n        return"
)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DiskMachine]:
    """One machine for the tests of this module, in their order: to switch it on takes minutes."""
    with own_disk() as image, switched_on(image, tmp_path_factory.mktemp("machine")) as machine:
        yield machine


def shown(capsys: pytest.CaptureFixture[str], text: str) -> None:
    with capsys.disabled():
        print(f"\n{text}; {load()}")  # noqa: T201 - figures are for people


def test_the_disk_boots_with_the_network_that_there_is_and_its_node_is_ready_with_ros(
    machine: DiskMachine, capsys: pytest.CaptureFixture[str]
) -> None:
    ssh_s = time.monotonic() - machine.began_s
    machine.run(UNWATCHED)
    ready_s = machine.wait_until(f"systemctl is-active --quiet {NODE}", 1800)
    restarts = machine.property("NRestarts", NODE)
    journal = machine.run(f"journalctl -b -u {NODE} -o short-monotonic --no-pager")
    starts = [line for line in journal.splitlines() if "Starting segway-ecc-node" in line]
    firsts = [line for line in journal.splitlines() if " runs at 5 Hz" in line]
    start_s, first_s = (float(lines[0][1:].split("]")[0]) for lines in (starts, firsts))
    shown(
        capsys,
        f"disk in QEMU: ssh {ssh_s:.0f} s after power-on, node ready {ready_s:.0f} s; of the guest's clock: service "
        f"start {start_s:.0f} s, first cycle {first_s - start_s:.0f} s later, restarts {restarts}",
    )
    assert "--no-ros" not in machine.run(f"tr '\\0' ' ' < /proc/$(systemctl show -P MainPID {NODE})/cmdline")
    assert "10.0.2.15/24" in machine.run("ip -brief address"), "QEMU's DHCP, by systemd-networkd"
    assert " ro," in machine.run("grep ' / ext4 ' /proc/mounts")
    assert machine.run("cat /proc/sys/kernel/hostname").strip() == "robot-on-disk"
    # As the service's user: ROS keeps a log in the home folder, and root's is read-only here.
    environment = "env HOME=/var/lib/segway-ecc $(grep ROS_ /etc/segway-ecc/environment)"
    look = f"{environment} segway-ecc station status --json --wait 60"
    seen = machine.run(f"cd /; runuser -u segway -- {look} 2> /run/status", 600, check=False)
    assert '"shaker"' in seen, "another process of the machine finds the robot over ROS"


def test_the_doctor_finds_a_robot_s_computer(machine: DiskMachine) -> None:
    found = json.loads(machine.run("segway-ecc deploy doctor --json", 900, check=False))["findings"]
    verdicts = {each["name"]: each["verdict"] for each in found}
    # A slow machine is one, so what is measured in real time is not asked.
    fit = ["kernel", "CAN in the kernel", "real-time scheduling", "memory lock", "processor idle states", "memory"]
    fit += ["disk space", "Python", "segway-ecc-archive.service", "segway-ecc-station.service", "segway-ecc.target"]
    assert {name: verdicts[name] for name in fit} == dict.fromkeys(fit, "good")
    assert set(verdicts) >= {
        "wake-ups",
        "disk speed",
        "ROS 2",
        "time synchronisation",
        NODE,
        "segway-ecc-guard.service",
    }


def test_updates_from_this_host_are_tried_kept_and_taken_back(
    machine: DiskMachine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine.run(UNWATCHED)
    shipped = machine.run("readlink /opt/segway-ecc/current").strip().removeprefix("releases/")
    took: list[str] = []

    def deploy(what: str, *words: str) -> tuple[int, dict[str, Any]]:
        began_s = time.monotonic()
        code = main(["deploy", *words[:1], "robot", *words[1:], "--ssh-config", str(machine.ssh_config), "--json"])
        took.append(f"{what} {time.monotonic() - began_s:.0f} s")
        captured = capsys.readouterr()
        assert captured.out, captured.err
        return code, json.loads(captured.out)

    code, ended = deploy("push", "push", "--start", "900")
    good = ended["current"]
    assert (code, ended["outcome"]) == (0, "healthy"), ended
    assert good != shipped
    folder = tmp_path / "broken"
    folder.mkdir()
    (folder / "robot.yaml").write_text(SLOW_ROBOT["robot.yaml"])
    model = SLOW_ROBOT["robot/shaker.py"].replace("\n    def output(self):\n        return", BREAKS)
    (folder / "shaker.py").write_text(model)
    code, ended = deploy("a broken one, and back", "push", "--start", "900", "--robot", str(folder / "robot.yaml"))
    assert (code, ended["outcome"], ended["current"]) == (WENT_BACK, "went-back", good), ended
    code, ended = deploy("rollback", "rollback", "--start", "900")
    assert (code, ended["outcome"], ended["current"]) == (0, "healthy", shipped), ended
    code, ended = deploy("status with every hash", "status", "--verify")
    states = {release["name"]: release["state"] for release in ended["releases"]}
    assert (states[good], states[shipped], len(states)) == ("healthy", "healthy", 3), ended
    assert all(not release["changed"] for release in ended["releases"])
    assert ended["node"]["status"]["mode"] == "DISARMED"
    shown(capsys, f"updates of a disk in QEMU from this host: {', '.join(took)}")

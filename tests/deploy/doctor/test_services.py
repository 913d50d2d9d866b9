# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict
from segway_ecc.deploy.doctor.services import check_services, properties
from tests.deploy.doctor.fake_machine import UNIT, FakeMachine, by_name, container, workload

NODE = "segway-ecc-node.service"


def looked(fake: FakeMachine) -> dict[str, Finding]:
    return by_name(list(check_services(fake.machine, workload(fake.root))))


def test_all_is_well(fake: FakeMachine) -> None:
    found = looked(fake)
    assert list(found) == [NODE, "segway-ecc-guard.service"]
    assert {(each.verdict, each.found) for each in found.values()} == {(Verdict.GOOD, "enabled, active (running)")}


def test_the_others_are_looked_at_where_they_are_installed(fake: FakeMachine) -> None:
    fake.systemd(station=UNIT.replace("active\n", "inactive\n").replace("running", "dead"))
    found = looked(fake)["segway-ecc-station.service"]
    assert (found.verdict, found.found) == (Verdict.WARNING, "enabled, inactive (dead)")
    assert found.remedy == "sudo systemctl start segway-ecc-station.service"


def test_a_robot_is_no_base_station_and_a_base_station_that_is_off_is_one_that_does_not_start(
    fake: FakeMachine,
) -> None:
    """As the image ships it, and as `segway-ecc station install` leaves its mark."""
    off = "LoadState=loaded\nUnitFileState=disabled\nActiveState=inactive\nSubState=dead\nNRestarts=0\n"
    fake.systemd(station=off)
    found = looked(fake)["segway-ecc-station.service"]
    assert (found.verdict, found.found) == (Verdict.GOOD, "off: this machine is no base station")
    fake.write({"/etc/segway-ecc/station.environment": ""})
    found = looked(fake)["segway-ecc-station.service"]
    assert (found.verdict, found.found) == (Verdict.WARNING, "disabled, inactive (dead)")


def test_a_list_has_a_line_for_each_of_its_values(fake: FakeMachine) -> None:
    """As systemd 252 shows it."""
    fake.systemd(node="LoadState=loaded\nDeviceAllow=char-ttyS rw\nDeviceAllow=char-ttyUSB rw\nUser=segway\n")
    found = properties(fake.machine, NODE, ["DeviceAllow", "User"])
    assert (found["DeviceAllow"], found["User"]) == ("char-ttyS rw char-ttyUSB rw", "segway")


def test_not_installed(fake: FakeMachine) -> None:
    del fake.answers["segway-ecc-guard"]
    found = looked(fake)["segway-ecc-guard.service"]
    assert (found.verdict, found.found) == (Verdict.WARNING, "not installed")
    assert "segway-ecc deploy push" in found.remedy


@pytest.mark.parametrize(
    ("old", "new", "verdict", "remedy"),
    [
        ("=enabled", "=disabled", Verdict.WARNING, f"sudo systemctl enable --now {NODE}"),
        (
            "=loaded\nUnitFileState=enabled",
            "=masked\nUnitFileState=masked",
            Verdict.WARNING,
            f"sudo systemctl unmask {NODE}; sudo systemctl enable --now {NODE}",
        ),
        (
            "State=active",
            "State=failed",
            Verdict.BAD,
            f"journalctl --boot --unit {NODE}; then: sudo systemctl restart {NODE}",
        ),
        ("State=active", "State=activating", Verdict.WARNING, f"sudo systemctl start {NODE}"),
    ],
)
def test_a_unit_in_trouble(fake: FakeMachine, old: str, new: str, verdict: Verdict, remedy: str) -> None:
    fake.systemd(node=UNIT.replace(old, new))
    found = looked(fake)[NODE]
    assert (found.verdict, found.remedy) == (verdict, remedy)


def test_masked_unit_is_ignored_for_privileges(fake: FakeMachine) -> None:
    """Systemd shows it as root's, and as nobody's: its settings are not read."""
    fake.systemd(node="LoadState=masked\nUnitFileState=masked\nUser=\n")
    assert properties(fake.machine, NODE, ["User"]) == {}


def test_one_that_dies_as_it_starts(fake: FakeMachine) -> None:
    restarting = UNIT.replace("=active", "=activating").replace("running", "auto-restart").replace("ts=0", "ts=7")
    fake.systemd(node=restarting)
    found = looked(fake)[NODE]
    assert (found.verdict, found.found) == (Verdict.BAD, "enabled, activating (auto-restart), restarted 7 times")


def test_no_systemd(tmp_path: Path) -> None:
    fake = container(tmp_path)
    assert {name: each.verdict for name, each in looked(fake).items()} == {"services": Verdict.WARNING}
    assert properties(fake.machine, NODE, ["User"]) == {}
    assert not fake.asked


def test_a_systemd_that_does_not_answer(fake: FakeMachine) -> None:
    fake.answers = {"systemctl": "!systemctl: Failed to connect to bus"}
    assert properties(fake.machine, NODE, ["User"]) == {}

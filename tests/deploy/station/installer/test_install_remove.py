# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.station.installer.install import install, plan, remove
from segway_ecc.deploy.station.installer.machine import ACCESS, FOLDER, TargetMachine
from segway_ecc.deploy.station.installer.settings import ALL_FILES, FIREWALL, PENDING, STATION, InstallSettings
from tests.deploy.station.installer.conftest import COMMAND, Fake

LOGS = {f"{FOLDER}/audit.jsonl", "/var/log/segway-ecc/logs/a.mcap"}


def names(fake: Fake) -> set[str]:
    return {f"/{path.relative_to(fake.root)}" for path in fake.root.rglob("*") if path.is_file() or path.is_symlink()}


@pytest.mark.parametrize("is_live", [True, False])
def test_all_goes_but_the_logs(fake: Fake, *, is_live: bool) -> None:
    before = names(fake) | ({"/etc/passwd"} if is_live else set())
    machine = TargetMachine(fake.root, is_live=is_live)
    install(
        plan(machine, InstallSettings(port=8799, firewall="eth0"), COMMAND), new_tokens=False, show=lambda _tokens: None
    )
    for name in LOGS:
        machine.write(name, "a log")
    fake.calls()
    gone = remove(machine)
    assert {ACCESS, *ALL_FILES} - {PENDING} <= set(gone)
    assert names(fake) == before | LOGS
    assert not machine.path("/etc/segway-ecc").exists()
    expected = [
        f"systemctl --quiet disable --now {STATION}",
        f"systemctl --quiet disable --now {FIREWALL}",
        "systemctl daemon-reload",
    ]
    assert fake.calls() == (expected if is_live else [])
    assert remove(machine) == []


def test_what_a_robot_on_the_same_machine_has_stays(fake: Fake) -> None:
    fake.machine.write("/etc/segway-ecc/robot.yaml", "a robot")
    install(plan(fake.machine, InstallSettings(port=8799), COMMAND), new_tokens=False, show=lambda _tokens: None)
    remove(fake.machine)
    assert fake.text("/etc/segway-ecc/robot.yaml") == "a robot"

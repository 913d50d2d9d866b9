# SPDX-License-Identifier: MIT
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.installer.checks import check_rules
from segway_ecc.deploy.station.installer.install import Plan, commands, install, plan
from segway_ecc.deploy.station.installer.machine import TargetMachine
from segway_ecc.deploy.station.installer.settings import (
    ENVIRONMENT,
    FIREWALL,
    RULES,
    STATION,
    SYSUSERS,
    UNITS,
    InstallSettings,
)
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.site_address import bind
from segway_ecc.node.errors import ConfigurationError, NodeError
from tests.deploy.station.installer.conftest import COMMAND, Fake

UNIT = f"{UNITS}/{STATION}"
LINKS = f"{UNITS}/multi-user.target.wants"
START = ["systemd-sysusers " + SYSUSERS, "systemctl daemon-reload", "systemctl --quiet enable " + STATION]
FREE = 8799


def planned(fake: Fake, **settings: Any) -> Plan:
    return plan(fake.machine, InstallSettings(**{"port": FREE, **settings}), COMMAND)


def do(made: Plan, *, new_tokens: bool = False) -> tuple[list[str], list[Mapping[Role, str]]]:
    """What was changed, and the tokens that were shown."""
    shown: list[Mapping[Role, str]] = []
    return install(made, new_tokens=new_tokens, show=shown.append), shown


def test_the_first_time_makes_all_of_it_and_the_tokens_before_the_service_starts(fake: Fake) -> None:
    made = planned(fake)
    assert fake.calls() == []
    kept = []

    def show(_tokens: Mapping[Role, str]) -> None:
        kept.extend(fake.calls())
        assert not fake.machine.path(ENVIRONMENT).exists()  # whatever fails from here on, they are shown

    changed = install(made, new_tokens=False, show=show)
    assert changed == [SYSUSERS, ENVIRONMENT, UNIT]
    assert kept == START[:1]
    assert fake.calls() == [*START[1:], f"systemctl restart {STATION}"]
    assert [*kept, *START[1:], f"systemctl restart {STATION}"] == [" ".join(words) for words in commands(made)]
    assert f"ExecStart={COMMAND} station serve" in fake.text(UNIT)
    assert "--port 8799" in fake.text(ENVIRONMENT)


def test_the_second_time_changes_nothing_and_lets_the_service_run(fake: Fake) -> None:
    do(planned(fake))
    before = fake.files()
    fake.calls()
    assert do(planned(fake)) == ([], [])
    assert fake.calls()[-1] == f"systemctl start {STATION}"
    assert {name: found for name, found in fake.files().items() if not name.endswith("calls")} == before


def test_another_setting_restarts_the_service_and_keeps_the_tokens(fake: Fake) -> None:
    do(planned(fake))
    fake.calls()
    assert do(planned(fake, domain=3)) == ([ENVIRONMENT], [])
    assert fake.calls()[-1] == f"systemctl restart {STATION}"
    assert 'ROS_DOMAIN_ID="3"' in fake.text(ENVIRONMENT)


def test_new_tokens_restart_the_service_which_knows_the_old_ones(fake: Fake) -> None:
    (first,) = do(planned(fake))[1]
    fake.calls()
    changed, (second,) = do(planned(fake), new_tokens=True)
    assert changed == []
    assert set(first.values()).isdisjoint(second.values())
    assert fake.calls()[-1] == f"systemctl restart {STATION}"


def test_what_was_interrupted_goes_on(fake: Fake) -> None:
    fake.fail(f"systemctl restart {STATION}")
    shown: list[Mapping[Role, str]] = []
    with pytest.raises(NodeError, match="no such luck"):
        install(planned(fake), new_tokens=False, show=shown.append)
    assert len(shown) == 1  # they are good, whatever came next
    fake.succeed()
    fake.calls()
    assert do(planned(fake)) == ([], [])
    # The files are as they should be; what runs may not know them yet.
    assert fake.calls()[-1] == f"systemctl restart {STATION}"
    do(planned(fake))
    assert fake.calls()[-1] == f"systemctl start {STATION}"


def test_a_service_that_did_not_get_well_is_started_anew_the_next_time(
    fake: Fake, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ill(_settings: InstallSettings, _timeout_ns: int) -> None:
        raise NodeError("ill")

    with monkeypatch.context() as patch:
        patch.setattr("segway_ecc.deploy.station.installer.install.wait_until_healthy", ill)
        with pytest.raises(NodeError, match="ill"):
            do(planned(fake))
    fake.calls()
    do(planned(fake))
    assert fake.calls()[-1] == f"systemctl restart {STATION}"


def test_a_firewall_comes_before_the_station_and_goes_when_it_is_no_longer_wanted(fake: Fake) -> None:
    changed, _ = do(planned(fake, firewall="eth0"))
    assert changed == [SYSUSERS, ENVIRONMENT, UNIT, RULES, f"{UNITS}/{FIREWALL}"]
    assert fake.calls()[-3:] == [
        f"systemctl --quiet enable {FIREWALL} {STATION}",
        f"systemctl reload-or-restart {FIREWALL}",
        f"systemctl restart {STATION}",
    ]
    do(planned(fake))
    assert f"systemctl --quiet disable --now {FIREWALL}" in fake.calls()
    assert not fake.machine.path(RULES).exists()
    assert not fake.machine.path(f"{UNITS}/{FIREWALL}").exists()


def test_an_image_gets_the_same_files_and_links_in_place_of_systemctl(fake: Fake) -> None:
    do(planned(fake, firewall="eth0"))
    text = fake.text(UNIT)
    fake.machine.path(UNIT).unlink()
    fake.calls()
    machine = TargetMachine(fake.root, is_live=False)
    made = plan(machine, InstallSettings(firewall="eth0"), COMMAND)
    assert commands(made) == []
    for _ in range(2):
        do(made)
    assert fake.text(UNIT) == text
    assert fake.calls() == []
    links = {path.name: str(path.readlink()) for path in machine.path(LINKS).iterdir()}
    assert links == {name: f"{UNITS}/{name}" for name in (STATION, FIREWALL)}
    do(plan(machine, InstallSettings(), COMMAND))
    assert [path.name for path in machine.path(LINKS).iterdir()] == [STATION]
    assert not machine.path(RULES).exists()


def test_no_systemd_is_refused(fake: Fake) -> None:
    (fake.root / "run/systemd/system").rmdir()
    with pytest.raises(ConfigurationError, match="no systemd runs here"):
        planned(fake)


def test_a_firewall_without_nft_is_refused(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _name: None)
    with pytest.raises(ConfigurationError, match="apt-get install nftables"):
        planned(fake, firewall="eth0")


def test_a_kernel_that_does_not_take_the_rules_is_refused_before_anything_is_written(fake: Fake) -> None:
    """Words of nft 1.0.6 where the kernel has no family inet; what it says last is a row of carets."""
    output = "/dev/stdin:6:1-22: Error: Could not process rule: Operation not supported"
    (fake.bin / "nft").write_text(
        f'#!/bin/sh\ncat > "{fake.root}/rules"; echo "{output}" >&2; echo "^^^^" >&2; exit 1\n'
    )
    with pytest.raises(ConfigurationError, match=r"--firewall: this kernel .*: Operation not supported\); it needs"):
        check_rules(fake.machine, "table inet x\n")
    assert fake.text("rules") == "table inet x\n"
    before = fake.files()
    if os.geteuid() == 0:
        with pytest.raises(ConfigurationError, match="does not take the rules"):
            planned(fake, firewall="eth0")
        assert 'iifname "eth0"' in fake.text("rules")
        assert [name for name in fake.files() if name not in before] == []


def test_port_in_use_is_refused_unless_it_is_ours(fake: Fake) -> None:
    (taken,) = bind("127.0.0.1", 0)
    with taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigurationError, match=f"--port {port} cannot be listened on: Address already in use"):
            planned(fake, port=port)
        fake.machine.write(ENVIRONMENT, f'STATION_OPTIONS="--address 127.0.0.1 --port {port}"\n')
        with pytest.raises(ConfigurationError, match="Address already in use"):
            planned(fake, port=port)  # we are not running: it is somebody else's
        fake.machine.run(["systemctl", "start", STATION])
        planned(fake, port=port)
        fake.machine.write(ENVIRONMENT, f'STATION_OPTIONS="--address 127.0.0.1 --port {port + 1}"\n')
        with pytest.raises(ConfigurationError, match="Address already in use"):
            planned(fake, port=port)  # we are running at another one


@pytest.mark.parametrize("running", [False, True])
def test_an_address_that_is_not_ours_is_refused_also_while_we_have_the_port(fake: Fake, *, running: bool) -> None:
    if running:
        do(planned(fake))
    with pytest.raises(ConfigurationError, match=r"--address 192\.0\.2\.1 .* cannot be listened on"):
        planned(fake, address="192.0.2.1")


def _certificate(folder: Path) -> None:
    folder.mkdir(parents=True)
    kind = ["-x509", "-newkey", "rsa:2048", "-days", "2", "-subj", "/CN=base", "-nodes"]
    files = ["-keyout", str(folder / "k.pem"), "-out", str(folder / "c.pem")]
    subprocess.run(["openssl", "req", *kind, *files], check=True, capture_output=True)  # noqa: S607 - wherever it is


def test_a_certificate_is_tried_before_anything_is_written(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {"certificate": Path("/etc/tls/c.pem"), "key": Path("/etc/tls/k.pem")}
    with pytest.raises(ConfigurationError, match="cannot be used: No such file or directory"):
        planned(fake, **files)
    _certificate(fake.root / "etc/tls")
    made = planned(fake, **files)
    do(made)
    assert "--certificate /etc/tls/c.pem --key /etc/tls/k.pem" in fake.text(ENVIRONMENT)
    with pytest.raises(ConfigurationError, match=r"/root/c\.pem is not visible to the service"):
        planned(fake, certificate=Path("/root/c.pem"))
    # What root can read and the service's user cannot.
    monkeypatch.setattr("segway_ecc.deploy.station.installer.checks.tls_context", _refuse)
    with pytest.raises(ConfigurationError, match=r"as the user segway: no; .* setfacl -m u:segway:r /etc/tls/c\.pem"):
        do(made)


def _refuse(*_files: Path | None) -> None:
    raise ConfigurationError("no")


def test_missing_service_user_raises(fake: Fake) -> None:
    (fake.bin / "systemd-sysusers").write_text("#!/bin/sh\n")
    with pytest.raises(NodeError, match="systemd-sysusers made no user"):
        do(planned(fake))

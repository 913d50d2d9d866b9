# SPDX-License-Identifier: MIT
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from segway_ecc import deploy
from segway_ecc.deploy.station.installer.settings import (
    ALL_FILES,
    ENVIRONMENT,
    FIREWALL,
    PENDING,
    RULES,
    STATION,
    SYSUSERS,
    UNITS,
    InstallSettings,
    files,
)
from segway_ecc.node.errors import ConfigurationError
from tests.deploy.station.installer.conftest import COMMAND

SHIPPED = Path(deploy.__file__).parent
OPEN = InstallSettings(domain=7, port=9000, firewall="eth0")


def settings_of(text: str) -> list[str]:
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def test_without_a_firewall_there_is_none() -> None:
    made = files(InstallSettings(), COMMAND, {})
    assert set(made) == {SYSUSERS, ENVIRONMENT, f"{UNITS}/{STATION}"}
    assert set(files(OPEN, COMMAND, {})) == set(ALL_FILES) - {PENDING}


def test_the_unit_is_the_shipped_one_with_our_program_and_our_variables_after_the_robot_s() -> None:
    shipped = settings_of((SHIPPED / "systemd" / STATION).read_text())
    made = settings_of(files(InstallSettings(), COMMAND, {})[f"{UNITS}/{STATION}"])
    assert [line for line in made if line not in shipped] == [
        line
        for line in made
        if line.startswith(f"ExecStart={COMMAND} station serve ") or line == f"EnvironmentFile={ENVIRONMENT}"
    ]
    # The base station's own variables are not left out: without them it would serve without asking for a token.
    assert [line.split()[0] for line in shipped if line not in made] == [
        f"EnvironmentFile=-{ENVIRONMENT}",
        "ExecStart=/opt/segway-ecc/current/venv/bin/segway-ecc",
    ]
    read = [line.partition("=")[2].lstrip("-") for line in made if line.startswith("EnvironmentFile=")]
    assert read == ["/etc/segway-ecc/environment", ENVIRONMENT]  # what comes later counts
    (start,) = (line for line in made if line.startswith("ExecStart="))
    assert start.endswith("--folder /var/lib/segway-ecc/station --logs /var/log/segway-ecc/logs $STATION_OPTIONS")


def test_a_new_version_of_ours_is_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    before = files(InstallSettings(), COMMAND, {})[f"{UNITS}/{STATION}"]
    monkeypatch.setattr("importlib.metadata.version", lambda _name: "99.0")
    assert files(InstallSettings(), COMMAND, {})[f"{UNITS}/{STATION}"] != before


def test_the_firewall_closes_the_ports_of_the_domain_and_of_the_page_but_for_one_interface() -> None:
    rules = files(OPEN, COMMAND, {})[RULES]
    assert "define dds_ports = 9150-9399" in rules  # 7400 + 250 * 7, and the 249 after it
    assert "define page_port = 9000" in rules
    assert rules.count('iifname "eth0"') == 2
    assert "wg-robots" not in rules
    assert "42" not in rules
    shipped = (SHIPPED / "station" / "installer" / "base-station.nft").read_text()
    as_shipped = files(InstallSettings(domain=42, firewall="wg-robots"), COMMAND, {})[RULES]
    assert settings_of(as_shipped) == settings_of(shipped)


def test_the_station_waits_for_wireguard_since_dds_takes_no_later_interface() -> None:
    assert "After=wg-quick@eth0.service" in files(OPEN, COMMAND, {})[f"{UNITS}/{STATION}"].splitlines()


def test_the_firewall_is_closed_before_a_network_is_up() -> None:
    lines = files(OPEN, COMMAND, {})[f"{UNITS}/{FIREWALL}"].splitlines()
    assert "Before=network-pre.target shutdown.target" in lines
    assert f"ExecStart=/usr/sbin/nft -f {RULES}" in lines
    table = re.search(
        r"^table (inet \w+) {", (SHIPPED / "station" / "installer" / "base-station.nft").read_text(), re.MULTILINE
    )
    assert table is not None
    assert f"ExecStop=/usr/sbin/nft delete table {table[1]}" in lines


def test_unexpected_shipped_file_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.deploy.station.installer.settings._shipped", lambda _folder, _name: "[Service]\n")
    with pytest.raises(ConfigurationError, match="ExecStart="):
        files(InstallSettings(), COMMAND, {})


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
@pytest.mark.parametrize("name", [STATION, FIREWALL])
@pytest.mark.parametrize("spoilt", [False, True])
def test_systemd_has_nothing_against_a_rendered_unit(name: str, tmp_path: Path, *, spoilt: bool) -> None:
    shutil.copytree("/usr/lib/systemd/system", tmp_path / "usr/lib/systemd/system", symlinks=True)
    for path, content in files(OPEN, COMMAND, {}).items():
        place = tmp_path / path[1:]
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(content.replace("ProtectHome=", "ProtectHomes=") if spoilt else content)
    for program in (COMMAND, "/usr/sbin/nft"):
        place = tmp_path / program[1:]
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("#!/bin/sh\n")
        place.chmod(0o755)
    words = [shutil.which("systemd-analyze") or "", "verify", "--recursive-errors=yes", f"--root={tmp_path}", name]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ((done.returncode, done.stderr) == (0, "")) != spoilt

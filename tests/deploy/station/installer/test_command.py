# SPDX-License-Identifier: MIT
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.deploy.station.web.access import Role, load_access
from tests.deploy.station.installer.conftest import COMMAND, Fake, Outcome

Call = Callable[..., Outcome]
ACCESS = "var/lib/segway-ecc/station/access.json"
LIVE = ("--command", COMMAND, "--port", "8799")


def test_it_prints_the_tokens_once_and_the_address_to_open(base_station: Call, fake: Fake) -> None:
    outcome = base_station(*LIVE)
    assert outcome.code == 0
    output, operator, viewer = outcome.errors
    assert output == "segway-ecc: new tokens, shown this once; keep them:"
    access = load_access(fake.root / ACCESS)
    assert access is not None
    assert access.role(operator.split()[1]) is Role.OPERATOR
    assert access.role(viewer.split()[1]) is Role.VIEWER
    assert outcome.out.splitlines() == ["open    http://127.0.0.1:8799/", "tokens  new, shown above"]
    again = base_station(*LIVE)
    assert (again.code, again.errors) == (0, [])
    assert "as before (see --new-tokens)" in again.out
    assert len(base_station(*LIVE, "--new-tokens").errors) == 3


def test_json_has_it_for_programs(base_station: Call, fake: Fake) -> None:
    found = json.loads(base_station(*LIVE, "--json").out)
    assert found["open"] == "http://127.0.0.1:8799/"
    access = load_access(fake.root / ACCESS)
    assert access is not None
    assert {name: access.role(token) for name, token in found["tokens"].items()} == {r.value: r for r in Role}
    assert "/etc/segway-ecc/station.environment" in found["changed"]
    again = json.loads(base_station(*LIVE, "--json").out)
    assert again == {"open": found["open"], "tokens": {}, "changed": []}


def test_each_option_reaches_the_file_that_it_is_for(base_station: Call, fake: Fake) -> None:
    words = ["--domain", "42", "--peer", "alice", "--peer", "10.42.0.12", "--peer", "alice", "--host", "base"]
    outcome = base_station(*LIVE, *words, "--address", "0.0.0.0", "--firewall")  # noqa: S104 - a text
    assert outcome.code == 0
    text = fake.text("/etc/segway-ecc/station.environment")
    assert 'ROS_DOMAIN_ID="42"' in text
    assert 'ROS_STATIC_PEERS="alice;10.42.0.12"' in text
    assert "--address 0.0.0.0 --port 8799 --require-token --host base" in text
    assert 'iifname "wg-robots"' in fake.text("/etc/segway-ecc/base-station.nft")
    assert any("plain HTTP" in line for line in outcome.errors)


@pytest.mark.usefixtures("fake")
@pytest.mark.parametrize(
    "words",
    [
        ("--domain", "500"),
        ("--peer", "a;b"),
        ("--address", "nowhere at all"),
        ("--port", "80"),
        ("--key", "k.pem"),
        ("--discovery", "off"),
        ("--dry-run", "--remove"),
        ("--command", "/no/such/segway-ecc"),
        ("--root", "/no/such/folder"),
    ],
    ids=" ".join,
)
def test_what_is_wrong_is_one_line_and_changes_nothing(base_station: Call, fake: Fake, words: tuple[str, ...]) -> None:
    before = fake.files()
    outcome = base_station(*LIVE, *words)
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    assert outcome.out == ""
    assert fake.files() == before
    assert fake.calls() == []


@pytest.mark.parametrize("words", [(), ("--remove",)])
def test_install_without_root_shows_sudo_command(
    base_station: Call, fake: Fake, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.setattr("segway_ecc.deploy.verbs.station_install._is_root", lambda: False)
    before = fake.files()
    outcome = base_station(*LIVE, *words)
    assert outcome.code == 2
    (line,) = outcome.errors
    assert line.startswith("segway-ecc: only root may do this: sudo /")
    assert fake.files() == before


def test_a_dry_run_shows_every_file_and_command_to_anybody_and_does_nothing(
    base_station: Call, fake: Fake, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("segway_ecc.deploy.verbs.station_install._is_root", lambda: False)
    before = fake.files()
    outcome = base_station(*LIVE, "--domain", "42", "--dry-run")
    assert (outcome.code, outcome.errors) == (0, [])
    assert fake.files() == before
    assert fake.calls() == []
    lines = outcome.out.splitlines()
    assert [line for line in lines if line.startswith(("# /", "$ "))] == [
        "# /etc/sysusers.d/segway-ecc-station.conf (0644, root)",
        "# /etc/segway-ecc/station.environment (0644, root)",
        "# /etc/systemd/system/segway-ecc-station.service (0644, root)",
        "# /var/lib/segway-ecc/station/access.json (0600, segway)",
        "$ systemd-sysusers /etc/sysusers.d/segway-ecc-station.conf",
        "$ systemctl daemon-reload",
        "$ systemctl --quiet enable segway-ecc-station.service",
        "$ systemctl restart segway-ecc-station.service",
    ]
    assert 'ROS_DOMAIN_ID="42"' in lines
    monkeypatch.setattr("segway_ecc.deploy.verbs.station_install._is_root", lambda: True)
    base_station(*LIVE)
    assert "access.json" not in base_station(*LIVE, "--dry-run").out
    assert "access.json" in base_station(*LIVE, "--dry-run", "--new-tokens").out


def test_a_root_file_system_is_written_by_anybody_and_removed_again(
    base_station: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("segway_ecc.deploy.verbs.station_install._is_root", lambda: False)
    monkeypatch.setenv("PATH", "/nonexistent")  # nothing is run
    root = tmp_path / "image"
    (root / "usr/bin").mkdir(parents=True)
    (root / "usr/bin/segway-ecc").write_text("")
    outcome = base_station("--root", str(root), "--domain", "5")
    assert outcome.code == 0
    assert len(outcome.errors) == 4
    assert "has to belong to segway there" in outcome.errors[-1]  # nobody made the user
    unit = (root / "etc/systemd/system/segway-ecc-station.service").read_text()
    assert "ExecStart=/usr/bin/segway-ecc station serve" in unit
    assert (root / "etc/systemd/system/multi-user.target.wants/segway-ecc-station.service").is_symlink()
    assert base_station("--root", str(root), "--domain", "5").errors == outcome.errors[-1:]
    (root / "etc/passwd").write_text(f"segway:x:{os.geteuid()}:{os.getegid()}::/:/x\n")
    assert base_station("--root", str(root), "--domain", "5").errors == []
    (root / "etc/passwd").unlink()
    removed = base_station("--root", str(root), "--remove")
    assert "removed /etc/systemd/system/segway-ecc-station.service" in removed.out.splitlines()
    assert [path.name for path in root.rglob("*") if path.is_file() or path.is_symlink()] == ["segway-ecc"]
    assert base_station("--root", str(root), "--remove").out == "there was nothing\n"
    assert json.loads(base_station("--root", str(root), "--remove", "--json").out) == {"removed": []}

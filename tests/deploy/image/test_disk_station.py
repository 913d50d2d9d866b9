# SPDX-License-Identifier: MIT
"""`segway-ecc station install` under a real systemd: in user-mode Linux, and its firewall on a kernel that has one."""

import contextlib
import json
import time
import urllib.error
import urllib.request
from http import HTTPStatus
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.image import disk
from segway_ecc.deploy.image.build import image_in
from tests.deploy.image.disk_machine import PAGE_PORT, DiskMachine, disk_folder, load, own_disk, switched_on
from tests.deploy.image.uml_machine import Machine
from tests.deploy.image.uml_machine import switched_on as uml_switched_on

pytestmark = [pytest.mark.image, pytest.mark.proof, pytest.mark.timeout(7200)]
STATION = "segway-ecc-station.service"
FIREWALL = "segway-ecc-firewall.service"
ROBOTS = ("segway-ecc-node", "segway-ecc-guard", "segway-ecc-archive")
HOST = {"Host": f"127.0.0.1:{PAGE_PORT}"}
# What the machine asks itself: the page's health, and who is let in.
ASK = f"""import json, sys, urllib.error, urllib.request
body = json.dumps({{"name": "ann", "token": sys.argv[1]}}).encode()
words = {{"Content-Type": "application/json"}}
request = urllib.request.Request("http://127.0.0.1:{PAGE_PORT}/login", body, words)
try:
    print(urllib.request.urlopen(request, timeout=60).status)
except urllib.error.HTTPError as error:
    print(error.code)"""


def test_a_base_station_under_systemd_lets_in_who_has_a_token_also_after_a_restart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, data = image_in(disk_folder()), tmp_path / "data.ext4"
    disk.data_file_system(data, 512, 0)
    masks = [f"systemd.mask={name}.service" for name in ROBOTS]
    with uml_switched_on(image.root_file_system, data, tmp_path / "first", *masks) as machine:
        (machine.share / "ask.py").write_text(ASK, "ascii")
        refused = _base_station(machine, "--firewall eth0")
        assert refused["code"] == 2, refused
        assert "--firewall: this kernel does not take the rules" in refused["errors"]
        assert machine.run("ls /etc/systemd/system /etc/segway-ecc | grep -c station; true").strip() == "0"
        began_s = time.monotonic()
        made = _base_station(machine)
        took_s = time.monotonic() - began_s
        assert made["code"] == 0, made
        operator = made["answer"]["tokens"]["operator"]
        assert _state(machine) == ("active", "enabled", "0")
        assert [_login(machine, token) for token in (operator, operator[:-1])] == [204, 403]
        again = _base_station(machine)
        assert (again["code"], again["answer"]["changed"], again["answer"]["tokens"]) == (0, [], {}), again
        before = machine.property("MainPID", STATION)
        machine.run(f"kill -9 {before}")
        machine.wait_until(f"[ $(systemctl show -P MainPID {STATION}) != {before} ]", 120)
        _wait_until_well(machine)
        assert _login(machine, operator) == HTTPStatus.NO_CONTENT
        assert machine.run("systemctl --failed --no-legend --plain").strip() == ""
    with uml_switched_on(image.root_file_system, data, tmp_path / "second", *masks) as machine:
        (machine.share / "ask.py").write_text(ASK, "ascii")
        _wait_until_well(machine)
        assert _login(machine, operator) == HTTPStatus.NO_CONTENT
        assert _base_station(machine, "--remove")["code"] == 0
        assert machine.property("LoadState", STATION) == "loaded", "the image's own, which is off"
        assert machine.property("UnitFileState", STATION) == "disabled"
    with capsys.disabled():
        print(f"\nbase station under user-mode Linux: made and well after {took_s:.0f} s; {load()}")  # noqa: T201 - figures


@pytest.mark.rt_kernel
def test_the_firewall_is_loaded_keeps_others_out_and_is_there_again_after_a_power_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = f"segway-ecc station install --address 0.0.0.0 --port {PAGE_PORT} --json --firewall"
    with own_disk() as image:
        with switched_on(image, tmp_path / "first", *ROBOTS) as machine:
            began_s = time.monotonic()
            made = json.loads(machine.run(f"{command} ens3 2> /run/errors", 900))
            took_s = time.monotonic() - began_s
            assert made["open"]
            operator = made["tokens"]["operator"]
            assert _is_well(machine), "this host comes in through the interface that is let in"
            assert _login_from_here(machine, operator) == HTTPStatus.NO_CONTENT
            assert {FIREWALL: machine.property("ActiveState", FIREWALL)} == {FIREWALL: "active"}
            machine.run(f"{command} wg-robots 2> /run/errors", 900)
            assert not _is_well(machine), "the same with a firewall that lets nobody in from here"
            assert _dropped(machine) > 0
            machine.run("sync")
        with switched_on(image, tmp_path / "second", *ROBOTS) as machine:
            machine.wait_until(f"systemctl is-active --quiet {STATION}", 900)
            rules = machine.run("nft list table inet segway_ecc")
            assert 'iifname "wg-robots"' in rules
            assert f"tcp dport {PAGE_PORT}" in rules
            loaded, network = (
                int(machine.property(name, unit))
                for name, unit in (
                    ("ActiveEnterTimestampMonotonic", FIREWALL),
                    ("ActiveEnterTimestampMonotonic", "network.target"),
                )
            )
            assert 0 < loaded <= network, "closed before there is a network"
            machine.run(f"{command} ens3 2> /run/errors", 900)
            assert _login_from_here(machine, operator) == HTTPStatus.NO_CONTENT, "the token of before the power cut"
            machine.run("segway-ecc station install --remove", 300)
            assert "segway_ecc" not in machine.run("nft list ruleset")
    with capsys.disabled():
        print(f"\nbase station with firewall in QEMU: made and well after {took_s:.0f} s; {load()}")  # noqa: T201 - figures


def _base_station(machine: Machine, words: str = "") -> dict[str, Any]:
    """How the command ended: exit code, what it answered, and its errors."""
    share = "/run/share"
    code = machine.run(f"segway-ecc station install --json {words} > {share}/output 2> {share}/errors; echo $?", 900)
    output = (machine.share / "output").read_text("utf-8")
    errors = (machine.share / "errors").read_text("utf-8")
    return {"code": int(code.split()[-1]), "answer": json.loads(output or "{}"), "errors": errors}


def _state(machine: Machine) -> tuple[str, ...]:
    return tuple(machine.property(name, STATION) for name in ("ActiveState", "UnitFileState", "NRestarts"))


def _login(machine: Machine, token: str) -> int:
    return int(machine.run(f"python3 /run/share/ask.py {token}", 120).split()[-1])


def _wait_until_well(machine: Machine) -> None:
    health = f"http://127.0.0.1:{PAGE_PORT}/health"
    machine.wait_until(f"python3 -c \"import urllib.request as r; r.urlopen('{health}', timeout=20)\" 2>&1", 600)


def _is_well(machine: DiskMachine) -> bool:
    """Whether the page answers this host within a minute."""
    deadline_s = time.monotonic() + 60.0
    while time.monotonic() < deadline_s:
        request = urllib.request.Request(f"{machine.page}health", headers=HOST)  # noqa: S310 - our own
        with contextlib.suppress(OSError), urllib.request.urlopen(request, timeout=20) as answer:  # noqa: S310 - our own
            return bool(answer.read() == b"ok\n")
    return False


def _login_from_here(machine: DiskMachine, token: str) -> int:
    body = json.dumps({"name": "ann", "token": token}).encode()
    words = {**HOST, "Content-Type": "application/json"}
    request = urllib.request.Request(f"{machine.page}login", body, words)  # noqa: S310 - our own
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:  # noqa: S310 - our own
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return int(error.code)


def _dropped(machine: DiskMachine) -> int:
    """Packets that the rule for the page has refused."""
    rules = machine.run("nft --json list table inet segway_ecc")
    counters = [
        int(expression["counter"]["packets"])
        for entry in json.loads(rules)["nftables"]
        for expression in entry.get("rule", {}).get("expr", [])
        if "counter" in expression
    ]
    return sum(counters)

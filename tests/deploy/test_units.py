# SPDX-License-Identifier: MIT
"""The units as systemd itself reads them, and what they must contain."""

import configparser
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import pytest

from segway_ecc.node.cli.main import command_line, find_verbs
from segway_ecc.node.safety.settings import Span

DEPLOY = Path(__file__).parents[2] / "deploy"
UNITS = sorted((DEPLOY / "systemd").glob("*.service")) + sorted((DEPLOY / "systemd").glob("*.target"))
OTHERS = sorted((DEPLOY / "image" / "files").glob("*.service"))
SERVICES = ["node", "guard", "archive", "station"]
LEAVES_S = 15.0
"""From sitting to the end: ROS is left within 5 s, and the log closed within 10 s."""
COMMAND = "/opt/segway-ecc/current/venv/bin/segway-ecc"
MOST_EXPOSED = {"node": 25, "guard": 25, "archive": 25, "station": 25}


def sections(path: Path) -> dict[str, dict[str, list[str]]]:
    """A unit's settings, each with all its values, in order."""
    found: dict[str, dict[str, list[str]]] = {}
    name = ""
    for line in path.read_text("utf-8").splitlines():
        if line.startswith("["):
            name = line.strip("[]")
        elif line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found.setdefault(name, {}).setdefault(key, []).append(value)
    return found


def unit(name: str) -> dict[str, dict[str, list[str]]]:
    return sections(DEPLOY / "systemd" / f"segway-ecc-{name}.service")


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """A root folder with our units, those of this machine, and the commands that ours start."""
    units = tmp_path / "etc" / "systemd" / "system"
    units.mkdir(parents=True)
    for path in (*UNITS, *OTHERS):
        shutil.copy(path, units)
    shutil.copytree("/usr/lib/systemd/system", tmp_path / "usr/lib/systemd/system", symlinks=True)
    for command in (COMMAND, "/usr/lib/segway-ecc/configure", "/usr/bin/ssh-keygen"):
        place = tmp_path / command[1:]
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("#!/bin/sh\n", "ascii")
        place.chmod(0o755)
    return tmp_path


def analyze(*words: str) -> "subprocess.CompletedProcess[str]":
    words = (shutil.which("systemd-analyze") or "systemd-analyze", *words)
    return subprocess.run(words, capture_output=True, text=True, check=False)


@pytest.mark.systemd
@pytest.mark.parametrize("path", [*UNITS, *OTHERS], ids=lambda path: str(path.name))
def test_systemd_has_nothing_against_a_unit(path: Path, machine: Path) -> None:
    done = analyze("verify", "--recursive-errors=yes", f"--root={machine}", path.name)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.systemd
def test_systemd_would_have_something_against_a_key_that_does_not_exist(machine: Path) -> None:
    path = machine / "etc/systemd/system/segway-ecc-node.service"
    path.write_text(path.read_text("utf-8").replace("WatchdogSec=", "WatchdogSecs="), "utf-8")
    assert analyze("verify", "--recursive-errors=yes", f"--root={machine}", path.name).returncode != 0


@pytest.mark.systemd
@pytest.mark.parametrize("name", SERVICES)
def test_a_service_is_no_more_exposed_than_it_may_be(name: str) -> None:
    path = DEPLOY / "systemd" / f"segway-ecc-{name}.service"
    done = analyze("security", "--offline=true", f"--threshold={MOST_EXPOSED[name]}", str(path))
    found = re.search(r"Overall exposure level.*: ([\d.]+)", done.stdout)
    assert found is not None, done.stderr
    assert done.returncode == 0, f"{found.group()} of at most {MOST_EXPOSED[name] / 10}\n{done.stdout}"


def test_control_waits_for_no_network_and_for_nobody_but_the_guard() -> None:
    for name in ("node", "guard"):
        settings = unit(name)["Unit"]
        words = " ".join(" ".join(values) for values in settings.values())
        assert "online" not in words
        assert "Requires" not in settings
        assert (
            "BindsTo" not in settings
        )  # an adapter that is unplugged must not stop a robot that has a serial line too
    assert unit("node")["Unit"]["After"] == ["systemd-networkd.service segway-ecc-guard.service"]
    assert unit("guard")["Unit"]["Before"] == ["segway-ecc-node.service"]


def test_what_controls_is_started_again_for_ever_and_at_once() -> None:
    for name in ("node", "guard"):
        found = unit(name)
        assert found["Unit"]["StartLimitIntervalSec"] == ["0"]
        assert found["Service"]["Restart"] == ["always"]
        assert found["Service"]["RestartSec"] == ["100ms"]
        assert "sys-subsystem-net-devices-can0.device" in found["Install"]["WantedBy"]


def test_a_robot_that_balances_has_the_time_to_sit_down_before_it_is_killed() -> None:
    service = unit("node")["Service"]
    (limit,) = get_args(Span)[1:]
    (stop,) = service["TimeoutStopSec"]
    assert float(stop.removesuffix("s")) >= limit.le + LEAVES_S
    assert service.get("KillSignal", ["SIGTERM"]) == ["SIGTERM"]
    assert {"ExecStop", "FinalKillSignal", "SendSIGHUP"}.isdisjoint(service)
    # The stop goes the other way round: the guard stays until the node has gone.
    assert "segway-ecc-guard.service" in unit("node")["Unit"]["After"][0]


def test_the_kernel_may_ask_the_model_s_watchdog_before_the_node_ends() -> None:
    assert "seccomp" in unit("node")["Service"]["SystemCallFilter"][0].split()


def test_only_the_node_itself_notifies_systemd() -> None:
    service = unit("node")["Service"]
    assert service["Type"] == ["notify"]
    assert service["NotifyAccess"] == ["main"]
    assert service["WatchdogSec"] == ["2s"]


def test_real_time_and_memory_come_from_the_unit_without_any_capability() -> None:
    for name, priority, most in (("node", "50", "51"), ("guard", "60", "60")):  # the model's watchdog is above the loop
        service = unit(name)["Service"]
        assert service["CPUSchedulingPolicy"] == ["fifo"]
        assert (service["CPUSchedulingPriority"], service["LimitRTPRIO"]) == ([priority], [most])
        assert service["CPUSchedulingResetOnFork"] == ["yes"]
        assert service["LimitMEMLOCK"] == ["infinity"]
        assert service["CapabilityBoundingSet"] == service["AmbientCapabilities"] == [""]


def test_each_service_reaches_what_it_needs_and_no_more() -> None:
    families = {name: set(unit(name)["Service"]["RestrictAddressFamilies"][0].split()) for name in SERVICES}
    assert families["node"] == {"AF_UNIX", "AF_CAN", "AF_INET", "AF_INET6", "AF_NETLINK"}
    assert families["guard"] == {"AF_UNIX", "AF_CAN", "AF_NETLINK"}
    assert families["archive"] == families["station"] == {"AF_UNIX", "AF_INET", "AF_INET6", "AF_NETLINK"}
    serial = [f"char-{name} rw" for name in ("ttyUSB", "ttyACM", "ttyAMA", "ttyS")]
    assert unit("node")["Service"]["DeviceAllow"] == [*serial, "/dev/cpu_dma_latency w"]
    assert "PrivateDevices" not in unit("node")["Service"]  # it would hide the serial line


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_runs_the_release_in_use_as_its_own_user(name: str) -> None:
    service = unit(name)["Service"]
    assert service["ExecStart"][0].startswith(f"{COMMAND} ")
    assert service["User"] == ["segway"]
    # What is read later counts: the machine's word above the release's, the station's above the robot's beside it.
    release, robot, station = (
        "-/opt/segway-ecc/current/environment",
        "-/etc/segway-ecc/environment",
        "-/etc/segway-ecc/station.environment",
    )
    assert service["EnvironmentFile"] == ([robot, station] if name == "station" else [release, robot])


def test_the_archive_keeps_out_of_the_way_of_control() -> None:
    service = unit("archive")["Service"]
    assert service["CPUSchedulingPolicy"] == ["batch"]
    assert service["IOSchedulingClass"] == ["idle"]


@pytest.mark.parametrize("name", ["node", "guard", "archive", "station"])
def test_the_command_line_of_a_service_is_one_that_the_command_takes(name: str) -> None:
    """What the unit gives to the command, but for the robot file, which is not here."""
    service = unit(name)["Service"]
    variables = dict(re.findall(r'"(\w+_OPTIONS)=([^"]*)"', "\n".join(service["Environment"])))
    words: Sequence[str] = service["ExecStart"][0].split()[1:]
    words = [part for word in words for part in (variables[word[1:]].split() if word.startswith("$") else [word])]
    options = command_line(find_verbs(), words).parse_args(words)
    if name in ("node", "guard"):
        assert (options.interface, options.channel) == ("socketcan", "can0")
    if name != "station":
        assert options.robot == "/etc/segway-ecc/robot.yaml"


def networkd(name: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(DEPLOY / "network" / name)
    return parser


def test_can_comes_up_by_itself_and_nothing_waits_for_it() -> None:
    can = networkd("80-segway-can.network")
    assert can["CAN"]["BitRate"] == "500K"
    assert can["CAN"]["RestartSec"] == "100ms"
    for name in ("80-segway-can.network", "80-segway-vcan.network"):
        assert networkd(name)["Link"]["RequiredForOnline"] == "no"
    assert networkd("80-segway-can.link")["Link"]["TransmitQueueLength"] == "64"
    assert dict(networkd("80-segway-vcan.netdev")["NetDev"]) == {"Name": "vcan0", "Kind": "vcan"}


def test_udev_rules_jump_to_labels_that_come_later() -> None:
    for path in sorted((DEPLOY / "udev").glob("*.rules")):
        text = path.read_text("utf-8")
        for label in re.findall(r'GOTO="(\w+)"', text):
            assert text.index(f'LABEL="{label}"') > text.rindex(f'GOTO="{label}"')


def test_the_serial_line_has_the_name_that_robot_files_use() -> None:
    text = (DEPLOY / "udev" / "70-segway-serial.rules").read_text("utf-8")
    assert 'SYMLINK+="segway-serial"' in text
    assert 'GROUP="dialout"' in text


def test_the_nodes_group_may_keep_the_processors_awake() -> None:
    text = (DEPLOY / "udev" / "70-segway-latency.rules").read_text("utf-8")
    rule = dict(re.findall(r'(\w+)==?"([^"]*)"', text))
    assert f"/dev/{rule['KERNEL']} w" in unit("node")["Service"]["DeviceAllow"]
    users = (DEPLOY / "systemd" / "segway-ecc.sysusers.conf").read_text("utf-8")
    assert rule["GROUP"] == users.split()[1]
    assert rule["MODE"] == "0660"

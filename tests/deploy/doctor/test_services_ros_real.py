# SPDX-License-Identifier: MIT
"""The doctor and `run` under the same settings of ROS: what the one cannot start under, the other finds."""

from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Finding, Probes, System, Verdict, Workload
from segway_ecc.deploy.doctor.services import check_ros
from tests.ros_processes import Start

pytestmark = pytest.mark.ros

STOPS = [
    {"ROS_DOMAIN_ID": "300"},
    {"RMW_IMPLEMENTATION": "rmw_nosuch"},
    {"ROS_LOG_DIR": "/proc/nowhere"},
    {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"},
]
GOES_ON = [
    {"FASTRTPS_DEFAULT_PROFILES_FILE": "/nowhere.xml"},
    {"ROS_DISCOVERY_SERVER": "bad:x"},
    {"ROS_SECURITY_ENABLE": "true"},
]


def found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, settings: dict[str, str]) -> dict[str, Finding]:
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    return {each.name: each for each in check_ros(System(Probes(), environment=settings), Workload(tmp_path, 0))}


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, ros_environment: dict[str, str]) -> None:
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR"):
        monkeypatch.setenv(name, ros_environment[name])


@pytest.mark.parametrize("settings", STOPS, ids="-".join)
def test_where_run_does_not_start_the_doctor_fails(
    start: Start, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, settings: dict[str, str]
) -> None:
    assert start("robot", "run", "cart", "--ros", "--no-log", "--duration", "0.1", env=settings).wait() == 5
    assert found(monkeypatch, tmp_path, settings)["ROS 2"].verdict is Verdict.BAD


@pytest.mark.parametrize("settings", GOES_ON, ids="-".join)
def test_where_run_goes_on_the_doctor_does_not_fail(
    start: Start, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, settings: dict[str, str]
) -> None:
    assert start("robot", "run", "cart", "--ros", "--no-log", "--duration", "0.1", env=settings).wait() == 0
    assert found(monkeypatch, tmp_path, settings)["ROS 2"].verdict is Verdict.GOOD


def test_security_that_is_not_enforced_is_reported_by_both(
    start: Start, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, messages: Path
) -> None:
    settings = {"ROS_SECURITY_ENABLE": "true"}
    text = (
        "ROS_SECURITY_ENABLE is true and ROS_SECURITY_STRATEGY is not Enforce: where keys are missing ROS goes on "
        "without security"
    )
    start("open", "run", "cart", "--ros", "--no-log", "--duration", "0.1", env=settings).wait()
    lines = (messages / "open.txt").read_text().splitlines()
    assert lines.count(f"segway-ecc: {text}; set ROS_SECURITY_STRATEGY=Enforce") == 1
    finding = found(monkeypatch, tmp_path, settings)["ROS security"]
    assert (finding.verdict, finding.found) == (Verdict.WARNING, text)
    assert finding.remedy == "ROS_SECURITY_STRATEGY=Enforce in the environment"
    settings["ROS_SECURITY_STRATEGY"] = "Enforce"
    assert "ROS security" not in found(monkeypatch, tmp_path, settings)

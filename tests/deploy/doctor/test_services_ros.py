# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict
from segway_ecc.deploy.doctor.services import check_ros
from tests.deploy.doctor.fake_machine import FakeMachine, by_name, workload


def looked(fake: FakeMachine, **environment: str) -> dict[str, Finding]:
    fake.environment = environment
    return by_name(list(check_ros(fake.machine, workload(fake.root))))


def test_all_is_well(fake: FakeMachine) -> None:
    assert {name: (each.verdict, each.found) for name, each in looked(fake).items()} == {
        "ROS 2": (Verdict.GOOD, "rclpy loads, with rmw_fastrtps_cpp"),
        "ROS domain": (Verdict.GOOD, "0"),
        "ROS discovery": (Verdict.GOOD, "the whole subnet"),
    }


def test_without_ros_the_robot_runs_alone(fake: FakeMachine) -> None:
    fake.answers["rclpy"] = "!env: ModuleNotFoundError: No module named 'rclpy'"
    found = looked(fake)["ROS 2"]
    assert found.verdict is Verdict.WARNING
    assert found.found == "rclpy does not load: ModuleNotFoundError: No module named 'rclpy'"
    assert "pip install 'segway-ecc[ros]'" in found.remedy


def test_a_ros_that_breaks_breaks_the_node(fake: FakeMachine) -> None:
    fake.answers["rclpy"] = "!env: Expected RMW implementation identifier of 'rmw_x'"
    found = looked(fake)["ROS 2"]
    assert found.verdict is Verdict.BAD
    assert "RMW_IMPLEMENTATION" in found.remedy


def test_a_ros_that_is_slow_is_not_broken(fake: FakeMachine) -> None:
    fake.answers["rclpy"] = "!env gave no answer within 60 s"
    found = looked(fake)["ROS 2"]
    assert (found.verdict, found.found) == (Verdict.WARNING, "rclpy did not load within 60 s")


@pytest.mark.parametrize(
    ("domain", "verdict"),
    [
        ("0", Verdict.GOOD),
        ("101", Verdict.GOOD),
        ("102", Verdict.WARNING),
        ("214", Verdict.WARNING),
        ("215", Verdict.GOOD),
        ("232", Verdict.GOOD),
        ("233", Verdict.BAD),
        ("abc", Verdict.BAD),
    ],
)
def test_domains(fake: FakeMachine, domain: str, verdict: Verdict) -> None:
    assert looked(fake, ROS_DOMAIN_ID=domain)["ROS domain"].verdict is verdict


LOCAL = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@pytest.mark.parametrize(
    ("environment", "verdict", "text"),
    [
        (LOCAL, Verdict.WARNING, "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST in the environment"),
        ({"ROS_LOCALHOST_ONLY": "1"}, Verdict.WARNING, "ROS_LOCALHOST_ONLY=1 in the environment"),
        ({"ROS_LOCALHOST_ONLY": "0"}, Verdict.GOOD, "the whole subnet"),
        (
            LOCAL | {"ROS_STATIC_PEERS": "10.0.0.1"},
            Verdict.GOOD,
            "this machine, and static peers 10.0.0.1, of the environment",
        ),
        (
            {"ROS_STATIC_PEERS": "10.0.0.1"},
            Verdict.GOOD,
            "the whole subnet, and static peers 10.0.0.1, of the environment",
        ),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "ROS_STATIC_PEERS": "10.0.0.1"},
            Verdict.WARNING,
            "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF in the environment",
        ),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "FAR"},
            Verdict.WARNING,
            "ROS_AUTOMATIC_DISCOVERY_RANGE=FAR in the environment",
        ),
        (
            LOCAL | {"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"},
            Verdict.GOOD,
            "by the discovery server 10.0.0.1:11811, of the environment",
        ),
    ],
)
def test_discovery(fake: FakeMachine, environment: dict[str, str], verdict: Verdict, text: str) -> None:
    found = looked(fake, **environment)["ROS discovery"]
    assert (found.verdict, found.found) == (verdict, text)


def test_the_services_own_settings_count_where_there_are_some(fake: FakeMachine) -> None:
    text = '# ours\n\nROS_DOMAIN_ID="42"\n;ROS_DOMAIN_ID=7\n RMW_IMPLEMENTATION=rmw_fastrtps_cpp\n'
    fake.write({"/etc/segway-ecc/environment": text})
    assert looked(fake, ROS_DOMAIN_ID="233")["ROS domain"].found == "42, of /etc/segway-ecc/environment"
    asked = next(words for words in fake.asked if words[0] == "env")
    assert asked[1:3] == ["ROS_DOMAIN_ID=42", "RMW_IMPLEMENTATION=rmw_fastrtps_cpp"]


@pytest.mark.parametrize(
    ("text", "verdict"), [("<profiles/>", Verdict.GOOD), ("<profiles>", Verdict.WARNING), (None, Verdict.WARNING)]
)
def test_the_file_of_profiles(fake: FakeMachine, text: str | None, verdict: Verdict) -> None:
    if text is not None:
        fake.write({"/etc/dds.xml": text})
    found = looked(fake, FASTRTPS_DEFAULT_PROFILES_FILE="/etc/dds.xml")["Fast DDS profiles"]
    assert found.verdict is verdict
    assert "/etc/dds.xml" in found.found

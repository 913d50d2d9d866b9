# SPDX-License-Identifier: MIT
"""Starting ROS, in a process of its own."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.node.errors import RosUnavailableError
from segway_ecc.node.ros.runtime import require_ros
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.ros

PUBLISHED = """
import sys
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import preload, ros_node

preload()
odometry = message_type("nav_msgs/msg/Odometry")
with ros_node("lean", "", parameters=True) as node:
    node.create_publisher(odometry, "odom", 1).publish(odometry())
print("rosidl_generator_py" in sys.modules, [name for name in ("em", "lark", "regex") if name in sys.modules])
"""

WAITING = """
from segway_ecc.node.ros.runtime import preload, ros_node, steady_executor

preload()
with ros_node("waiting", "") as node, steady_executor(node) as executor:
    executor.spin_once(timeout_sec=0.3)
    print("waited")
print("left")
"""
SET_BACK = Path(__file__).with_name("clock_set_back.c")


def test_messages_are_published_without_what_would_generate_them(ros_environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PUBLISHED], check=True, capture_output=True, text=True, env=ros_environment
    )
    assert done.stdout == "True []\n"


def test_a_wall_clock_that_is_set_back_prolongs_no_wait(ros_environment: dict[str, str], tmp_path: Path) -> None:
    library = tmp_path / "set_back.so"
    subprocess.run([shutil.which("cc") or "cc", "-shared", "-fPIC", "-o", library, SET_BACK, "-ldl"], check=True)
    done = subprocess.run(
        [sys.executable, "-c", WAITING],
        check=True,
        capture_output=True,
        text=True,
        env=ros_environment | {"LD_PRELOAD": str(library)},
        timeout=PATIENCE_S,
    )
    assert done.stdout == "waited\nleft\n"


@pytest.mark.parametrize(
    ("name", "value", "remedy"),
    [
        ("ROS_DOMAIN_ID", "233", "it must be a whole number from 0 to 232"),
        ("ROS_DOMAIN_ID", "-1", "it must be a whole number from 0 to 232"),
        ("ROS_DOMAIN_ID", "\u0663", "it must be a whole number from 0 to 232"),
        (
            "RMW_IMPLEMENTATION",
            "rmw_no_such_cpp",
            "which is not installed here: install it, or unset RMW_IMPLEMENTATION",
        ),
        ("RMW_IMPLEMENTATION", "no.such-rmw", "which is not installed here: install it, or unset RMW_IMPLEMENTATION"),
    ],
)
def test_an_environment_in_which_ros_cannot_start_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, remedy: str
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(RosUnavailableError, match=f"^{name} is '{value}'(:|,) {remedy}$"):
        require_ros()


@pytest.mark.parametrize(("name", "value"), [("ROS_DOMAIN_ID", "232"), ("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")])
def test_an_environment_in_which_ros_starts_is_accepted(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(name, value)
    require_ros()


@pytest.mark.parametrize("setting", ["RMW_IMPLEMENTATION=rmw_no_such_cpp", "ROS_DOMAIN_ID=500"])
@pytest.mark.parametrize("verb", ["run cart --ros --no-log", "sequence 1 0 1 --wait 1"])
def test_every_verb_ends_with_one_line_and_exit_code_5_where_ros_cannot_start(
    ros_environment: dict[str, str], setting: str, verb: str
) -> None:
    name, value = setting.split("=")
    command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *verb.split()]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=ros_environment | {name: value})
    assert (done.returncode, done.stdout) == (5, "")
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("segway-ecc: "))
    assert line.startswith(f"segway-ecc: {name} is '{value}'")

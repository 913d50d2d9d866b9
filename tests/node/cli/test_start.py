# SPDX-License-Identifier: MIT
"""A robot starts without what it does not need: each module costs time between a crash and the loop's return."""

import hashlib
import subprocess
import sys

import pytest

LATER = {
    "can": "only where a bus goes through python-can",
    "serial": "only where there is a serial line",
    "rclpy": "only with ROS",
    "segway_ecc.node.ros.remote": "only with ROS",
    "segway_ecc.node.ros.runtime": "only with ROS",
    "segway_ecc.node.ros.stage": "only with ROS",
    "segway_ecc.firmware_io.drives.cia402.driver": "only with such drives",
    "segway_ecc.firmware_io.drives.odrive.driver": "only with such drives",
    "segway_ecc.firmware_io.drives.odrive.frames": "only with such drives",
    "segway_ecc.firmware_io.drives.vesc.driver": "only with such drives",
    "segway_ecc.firmware_io.drives.wheel_board.driver": "only with such drives",
    "segway_ecc.firmware_io.imus.xsens_mti.driver": "only with such an IMU",
}
LOADED = "import sys; import segway_ecc.node.cli.main, segway_ecc.node.verbs.run; print(*sys.modules)"


@pytest.fixture(scope="module")
def loaded() -> set[str]:
    done = subprocess.run([sys.executable, "-c", LOADED], check=True, capture_output=True, text=True)
    return set(done.stdout.split())


def test_what_is_looked_for_has_the_name_it_is_looked_for_by() -> None:
    names = sorted(name for name in LATER if name != "rclpy")  # which is not everywhere
    subprocess.run([sys.executable, "-c", f"import {', '.join(names)}"], check=True)


@pytest.mark.parametrize("name", sorted(LATER))
def test_a_start_does_not_import(name: str, loaded: set[str]) -> None:
    assert name not in loaded, LATER[name]


def test_a_robot_takes_its_digests_without_openssl() -> None:
    said = (
        "import segway_ecc.node.cli.main as m; m.main(['run', 'nobody']); import hashlib; "
        "print(hashlib.sha256(b'segway').hexdigest(), 'libcrypto' in open('/proc/self/maps').read())"
    )
    done = subprocess.run([sys.executable, "-c", said], check=True, capture_output=True, text=True)
    assert done.stdout.split() == [hashlib.sha256(b"segway").hexdigest(), "False"]


def test_version_option_prints_the_version() -> None:
    done = subprocess.run(
        [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "--version"],
        check=True,
        capture_output=True,
        text=True,
    )
    found = subprocess.run(
        [sys.executable, "-c", "import importlib.metadata as m; print(m.version('segway-ecc'))"],
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stdout == found.stdout

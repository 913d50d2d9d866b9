# SPDX-License-Identifier: MIT
"""The variables that a release's services are started with."""

from pathlib import Path

from segway_ecc.deploy.release.agent.install import write_environment


def test_release_with_ros_sets_its_library_path(tmp_path: Path) -> None:
    packages = tmp_path / "venv" / "lib" / "python3.11" / "site-packages"
    (packages / "ros_rcl.libs").mkdir(parents=True)
    write_environment(tmp_path)
    assert not (tmp_path / "environment").exists(), "nothing looks for them"
    (packages / "ros_wheels_bootstrapper").mkdir()
    (packages / "ros_a.libs").mkdir()
    write_environment(tmp_path, Path("/opt/there"))
    there = "/opt/there/venv/lib"
    libraries = f"{there}:{there}/python3.11/site-packages/ros_a.libs:{there}/python3.11/site-packages/ros_rcl.libs"
    expected = f"_ROS_WHEELS_BOOTSTRAP_COMPLETE=1\nLD_LIBRARY_PATH={libraries}\n"
    assert (tmp_path / "environment").read_text("ascii") == expected
    write_environment(tmp_path)
    assert str(packages / "ros_a.libs") in (tmp_path / "environment").read_text("ascii")
    (packages / "ros_wheels_bootstrapper").rmdir()
    write_environment(tmp_path)
    assert not (tmp_path / "environment").exists()

# SPDX-License-Identifier: MIT
"""Which wheels a robot takes."""

from typing import Any

import pytest
from packaging.tags import Tag, cpython_tags
from packaging.utils import parse_wheel_filename

from segway_ecc.deploy.release.host import UpdateRefusedError
from segway_ecc.deploy.release.wheels import target_from

PI = {
    "python": [3, 12],
    "machine": "aarch64",
    "pointer_bits": 64,
    "libc": ["glibc", "2.36"],
    "soabi": "cpython-312-aarch64-linux-gnu",
    "system_ros": True,
    "robot_files": {},
    "has_robot_file": True,
}


def probe(**changes: Any) -> dict[str, Any]:
    return PI | changes


def tags(**changes: Any) -> set[Tag]:
    target = target_from(probe(**changes))
    major, minor = map(int, target.python.split("."))
    return set(cpython_tags((major, minor), [f"cp{major}{minor}"], target.platforms))


@pytest.mark.parametrize(
    ("wheel", "changes", "fits"),
    [
        ("numpy-2.5.5-cp312-cp312-manylinux_2_27_aarch64.manylinux_2_28_aarch64.whl", {}, True),
        ("numpy-2.5.5-cp312-cp312-manylinux_2_27_aarch64.whl", {"libc": ["glibc", "2.26"]}, False),
        ("numpy-2.5.5-cp312-cp312-manylinux_2_27_x86_64.whl", {}, False),
        ("numpy-2.5.5-cp311-cp311-manylinux_2_27_aarch64.whl", {}, False),
        ("zstandard-0.25.0-cp312-cp312-manylinux2014_aarch64.whl", {}, True),
        ("x-1-cp39-abi3-manylinux2014_aarch64.whl", {}, True),
        ("x-1-cp312-cp312-musllinux_1_2_aarch64.whl", {}, False),
        ("x-1-cp312-cp312-musllinux_1_2_aarch64.whl", {"soabi": "cpython-312-aarch64-linux-musl"}, True),
        ("x-1-cp312-cp312-manylinux2014_armv7l.whl", {"pointer_bits": 32}, True),
        ("x-1-cp312-cp312-linux_aarch64.whl", {}, True),
    ],
)
def test_a_wheel_fits_a_robot(*, wheel: str, changes: dict[str, Any], fits: bool) -> None:
    assert bool(parse_wheel_filename(wheel)[3] & tags(**changes)) is fits


def test_robots_of_one_kind_share_a_cache() -> None:
    assert target_from(probe()).key == "manylinux_2_36_aarch64-cp312"


def test_a_c_library_that_no_wheels_are_made_for_is_refused() -> None:
    with pytest.raises(UpdateRefusedError, match="no wheels are made for"):
        target_from(probe(libc=["", ""]))

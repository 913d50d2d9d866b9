# SPDX-License-Identifier: MIT
"""Which wheels fit a robot, from what it reports of itself; the names are those of PEP 425, 600 and 656."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from segway_ecc.deploy.release.errors import UpdateRefusedError

_SMALLER: Final = {"aarch64": "armv7l", "armv8l": "armv7l", "x86_64": "i686"}
"""What a 32-bit Python on a 64-bit kernel is."""
_LEGACY: Final = {"manylinux2014": 17, "manylinux2010": 12, "manylinux1": 5}
_OLDEST_GLIBC: Final = 5
_NEWEST_MUSL: Final = 2


@dataclass(frozen=True, slots=True)
class Target:
    """A robot's Python.

    Attributes:
        python: Such as `3.12`.
        machine: Such as `aarch64`.
        platforms: The platform tags that it takes, the best first.
        system_ros: Whether it has a ROS 2 of its own.
        robot_files: The robot file in use that came with a release, and what stands beside it, as manifest entries.
        has_robot_file: Whether it has a robot file at all.
    """

    python: str
    machine: str
    platforms: tuple[str, ...]
    system_ros: bool
    robot_files: Mapping[str, Mapping[str, Any]]
    has_robot_file: bool

    @property
    def key(self) -> str:
        """A name for all robots of this kind."""
        return f"{self.platforms[0]}-cp{self.python.replace('.', '')}"

    @property
    def pip_options(self) -> list[str]:
        """What has pip collect wheels for it."""
        short = self.python.replace(".", "")
        words = ["--only-binary=:all:", "--implementation=cp", f"--python-version={self.python}", f"--abi=cp{short}"]
        return [*words, *(f"--platform={platform}" for platform in self.platforms)]


def target_from(probe: Mapping[str, Any]) -> Target:
    """The target by the answer to a probe.

    Raises:
        UpdateRefusedError: No wheels are made for such a machine.
    """
    machine = str(probe["machine"])
    if probe["pointer_bits"] == 32:  # noqa: PLR2004 - 32 bits
        machine = _SMALLER.get(machine, machine)
    major, minor = probe["python"]
    return Target(
        python=f"{major}.{minor}",
        machine=machine,
        platforms=_platforms(machine, probe["libc"], str(probe["soabi"])),
        system_ros=bool(probe["system_ros"]),
        robot_files=probe["robot_files"],
        has_robot_file=bool(probe["has_robot_file"]),
    )


def _platforms(machine: str, libc: list[str], soabi: str) -> tuple[str, ...]:
    plain = f"linux_{machine}"
    if "musl" in soabi:
        return (*(f"musllinux_1_{n}_{machine}" for n in range(_NEWEST_MUSL, -1, -1)), plain)
    name, version = libc
    try:
        newest = int(version.split(".")[1])
    except (IndexError, ValueError):
        newest = 0
    if name != "glibc" or newest < _OLDEST_GLIBC:
        raise UpdateRefusedError(f"no wheels are made for a C library {name!r} {version!r}")
    old = [f"{tag}_{machine}" for tag, glibc in _LEGACY.items() if glibc <= newest]
    return (*(f"manylinux_2_{n}_{machine}" for n in range(newest, _OLDEST_GLIBC - 1, -1)), *old, plain)

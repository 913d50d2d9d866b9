# SPDX-License-Identifier: MIT
"""What an image consists of."""

import hashlib
import json
from dataclasses import dataclass
from typing import Final

SNAPSHOT: Final = "http://snapshot.debian.org/archive/debian/{stamp}/"
KERNELS: Final = {"none": (), "rt": ("linux-image-rt-amd64",), "cloud": ("linux-image-cloud-amd64",)}
"""Kernels by what they are for: of the image's own none, a robot's, and a virtual machine's (which has no CAN)."""
_PACKAGES: Final = (
    "ca-certificates",
    "dbus",
    "e2fsprogs",
    "iproute2",
    "kmod",
    "openssh-server",
    "python3",
    "python3-venv",
    "systemd",
    "systemd-resolved",
    "systemd-sysv",
    "udev",
)


@dataclass(frozen=True, slots=True)
class Recipe:
    """What is asked for.

    Attributes:
        suite: The Debian release.
        mirror: Where its packages come from.
        packages: Their names, each with =VERSION where it has to be that one.
        extras: Extras of our wheel.
        kernel: One of `KERNELS`.
        vcan: Whether a virtual CAN bus is there from the start, for tests and simulation.
        epoch: The time stamp of everything, seconds since the Unix epoch (SOURCE_DATE_EPOCH).
    """

    suite: str = "bookworm"
    mirror: str = "http://deb.debian.org/debian"
    packages: tuple[str, ...] = _PACKAGES
    extras: tuple[str, ...] = ("ros",)
    kernel: str = "rt"
    vcan: bool = False
    epoch: int = 1_735_689_600

    @property
    def all_packages(self) -> tuple[str, ...]:
        """The packages with those of the kernel."""
        pinned = {name.partition("=")[0] for name in self.packages}
        return (*self.packages, *(name for name in KERNELS[self.kernel] if name not in pinned))

    @property
    def base_digest(self) -> str:
        """Names what the packages depend on: an image with the same has the same packages."""
        parts = [self.suite, self.mirror, self.all_packages, self.epoch]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

# SPDX-License-Identifier: MIT
"""What is pushed: our wheel, the wheels of all it needs on that robot, pip itself, and the robot file."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from segway_ecc.deploy.release.agent.files import is_safe, sha256_of
from segway_ecc.node.errors import ConfigurationError

WHEEL: Final = "segway_ecc-*.whl"
"""Our own."""
_DIGITS: Final = 8


@dataclass(frozen=True, slots=True)
class Bundle:
    """A release to be pushed.

    Attributes:
        version: Of our wheel.
        requirement: Our wheel's path in the release, with its extras.
        files: Where each of its files lies here, by its path in the release.
        entries: SHA-256 and size of each, and of those that the robot has already.
        system_site: Whether the release sees the robot's own Python packages.
    """

    version: str
    requirement: str
    files: Mapping[str, Path]
    entries: Mapping[str, Mapping[str, Any]]
    system_site: bool = False

    @property
    def name(self) -> str:
        """The version and a digest of all content: other content never has the same name."""
        content = json.dumps([self.requirement, self.system_site, dict(self.entries)], sort_keys=True)
        return f"{self.version}-{hashlib.sha256(content.encode()).hexdigest()[:_DIGITS]}"

    def as_request(self, by: str) -> dict[str, Any]:
        """As the robot's side takes it."""
        return {
            "name": self.name,
            "version": self.version,
            "requirement": self.requirement,
            "system_site": self.system_site,
            "by": by,
            "files": dict(self.entries),
        }


def bundle(
    wheels: Sequence[Path],
    robot: Mapping[str, Path],
    extras: Sequence[str] = (),
    *,
    system_site: bool = False,
    held: Mapping[str, Mapping[str, Any]] | None = None,
) -> Bundle:
    """Put a release together.

    Args:
        wheels: All that pip collected, ours and pip's among them.
        robot: The robot file and what stands beside it, by path.
        extras: Extras of our wheel that are installed too.
        system_site: Whether the release sees the robot's own Python packages.
        held: ReleaseManifest entries of files that the robot has already and that belong to the release too.
    """
    files = {f"wheels/{path.name}": path for path in sorted(wheels)} | dict(robot)
    entries = {path: {"sha256": sha256_of(place), "size": place.stat().st_size} for path, place in files.items()}
    wheel = next(path for path in wheels if path.match(WHEEL))
    named = f"[{','.join(sorted(extras))}]" if extras else ""
    return Bundle(version_of(wheel), f"wheels/{wheel.name}{named}", files, entries | dict(held or {}), system_site)


def version_of(wheel: Path) -> str:
    """The version in a wheel's name.

    Raises:
        ConfigurationError: It is none of ours.
    """
    parts = wheel.name.split("-")
    if not wheel.match(WHEEL) or len(parts) < 5 or not wheel.is_file() or not is_safe(wheel.name):  # noqa: PLR2004 - PEP 427
        raise ConfigurationError(f"{wheel} is no wheel of segway-ecc (segway_ecc-VERSION-py3-none-any.whl)")
    return parts[1]

"""What is pushed: our wheel, the wheels of all it needs on that robot, pip itself, and the robot file."""

import contextlib
import dataclasses
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from deploy.release.agent.files import is_safe, sha256_of
from deploy.release.target import Target
from node.errors import ConfigurationError

_CHECKOUT: Final = Path(__file__).parents[2]
_WHEEL: Final = "segway_ecc-*.whl"
_DIGITS: Final = 8


@dataclass(frozen=True, slots=True)
class Installing:
    """How our wheel is installed.

    Attributes:
        extras: Extras of it that are installed too.
        system_site: Whether the release sees the robot's own Python packages.
    """

    extras: tuple[str, ...] = ()
    system_site: bool = False


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
        """The version and a digest of all content: other content never bears the same name."""
        content = json.dumps([self.requirement, self.system_site, dict(self.entries)], sort_keys=True)
        return f"{self.version}-{hashlib.sha256(content.encode()).hexdigest()[:_DIGITS]}"

    def as_request(self, by: str) -> dict[str, Any]:
        """As the robot's side takes it."""
        found = dataclasses.asdict(self)
        return {key: found[key] for key in ("version", "requirement", "system_site")} | {
            "name": self.name,
            "by": by,
            "files": dict(self.entries),
        }


def bundle(
    wheel: Path,
    wheels: Sequence[Path],
    robot: Mapping[str, Path],
    how: Installing,
    held: Mapping[str, Mapping[str, Any]],
) -> Bundle:
    """Put a release together.

    Args:
        wheel: Ours.
        wheels: All that pip collected, ours and pip's among them.
        robot: The robot file and what stands beside it, by path.
        how: How our wheel is installed.
        held: Manifest entries of files that the robot has already and that belong to the release too.
    """
    files = {f"wheels/{path.name}": path for path in sorted(wheels)} | dict(robot)
    entries: dict[str, Mapping[str, Any]] = {
        path: {"sha256": sha256_of(place), "size": place.stat().st_size} for path, place in files.items()
    }
    entries |= held
    named = f"[{','.join(sorted(how.extras))}]" if how.extras else ""
    return Bundle(version_of(wheel), f"wheels/{wheel.name}{named}", files, entries, how.system_site)


def version_of(wheel: Path) -> str:
    """The version in a wheel's name.

    Raises:
        ConfigurationError: It is none of ours.
    """
    parts = wheel.name.split("-")
    if not wheel.match(_WHEEL) or len(parts) < 5 or not wheel.is_file() or not is_safe(wheel.name):  # noqa: PLR2004 - PEP 427
        raise ConfigurationError(f"{wheel} is no wheel of segway-ecc (segway_ecc-VERSION-py3-none-any.whl)")
    return parts[1]


def build_wheel(folder: Path) -> Path:
    """Build our wheel from this checkout.

    Raises:
        ConfigurationError: This is none, or it cannot be built.
    """
    if not (_CHECKOUT / "pyproject.toml").exists():
        raise ConfigurationError("this segway-ecc is installed and no checkout: give the wheel with --wheel FILE")
    done = _pip(["wheel", "--no-deps", "--wheel-dir", str(folder), str(_CHECKOUT)])
    built = next(folder.glob(_WHEEL), None)
    if done.returncode or built is None:
        raise ConfigurationError(f"the wheel cannot be built: {_last(done.stderr)}")
    return built


def collect(wheel: Path, extras: Sequence[str], target: Target, folder: Path, *, refresh: bool) -> list[Path]:
    """Have pip collect all wheels for a robot: from the cache where that has them all, else from the index.

    Raises:
        ConfigurationError: Something has no wheel for it, or the index cannot be reached.
    """
    cache = _cache_folder() / target.key
    cache.mkdir(parents=True, exist_ok=True)
    named = f"[{','.join(sorted(extras))}]" if extras else ""
    words = ["download", *target.pip_options, "--find-links", str(cache), "--dest", str(folder)]
    what = [f"{wheel.resolve()}{named}", "pip"]
    done = None if refresh else _pip([*words, "--no-index", *what])
    if done is None or done.returncode:
        done = _pip([*words, *what])
    if done.returncode:
        raise ConfigurationError(
            f"the wheels for Python {target.python} on {target.machine} cannot be collected: {_last(done.stderr)}"
        )
    found = sorted(folder.glob("*.whl"))
    for path in found:
        if not path.match(_WHEEL):
            _keep(path, cache)
    return found


def _keep(path: Path, cache: Path) -> None:
    kept = cache / path.name
    if not kept.exists():
        new = cache / f".{path.name}.{os.getpid()}"
        shutil.copyfile(path, new)
        new.replace(kept)


def _cache_folder() -> Path:
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "segway-ecc" / "wheels"


def _pip(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pip", words[0], "--quiet", "--disable-pip-version-check", *words[1:]]
    return subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - no shell is in between


def _last(text: str) -> str:
    lines = [line.removeprefix("ERROR: ") for line in text.splitlines() if line.startswith("ERROR")]
    with contextlib.suppress(IndexError):
        return (lines or text.strip().splitlines())[-1]
    return "pip does not say why"

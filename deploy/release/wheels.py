# SPDX-License-Identifier: MIT
"""The wheels of a release: ours, and by pip all that it needs, of those that fit the robot.

The names of platforms are those of PEP 425, 600 and 656.
"""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from segway_ecc.deploy.release.agent.files import is_safe
from segway_ecc.deploy.release.agent.store import FileDigest, digests_from
from segway_ecc.deploy.release.host import UpdateRefusedError
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.folders import cache_folder

_SMALLER: Final = {"aarch64": "armv7l", "armv8l": "armv7l", "x86_64": "i686"}
"""What a 32-bit Python on a 64-bit kernel is."""
_LEGACY: Final = {"manylinux2014": 17, "manylinux2010": 12, "manylinux1": 5}
_OLDEST_GLIBC: Final = 5
_NEWEST_MUSL: Final = 2
WHEEL: Final = "segway_ecc-*.whl"
"""Our own."""
CHECKOUT: Final = Path(__file__).parents[3]
"""The folder above our package; of a checkout where it has a pyproject.toml."""
_NO_WHEEL: Final = re.compile(r"No matching distribution found for ([A-Za-z0-9][^\s;(]*)")
_MOST_BUILT: Final = 8


@dataclass(frozen=True, slots=True)
class Target:
    """A robot's Python.

    Attributes:
        python: Such as `3.12`.
        machine: Such as `aarch64`.
        platforms: The platform tags that it takes, the best first.
        system_ros: Whether it has a ROS 2 of its own.
        robot_files: The robot file in use that came with a release, and what stands beside it.
        has_robot_file: Whether it has a robot file at all.
    """

    python: str
    machine: str
    platforms: tuple[str, ...]
    system_ros: bool
    robot_files: Mapping[str, FileDigest]
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
        robot_files=digests_from(probe["robot_files"]),
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


def version_of(wheel: Path) -> str:
    """The version in a wheel's name.

    Raises:
        ConfigurationError: It is none of ours.
    """
    parts = wheel.name.split("-")
    if not wheel.match(WHEEL) or len(parts) < 5 or not wheel.is_file() or not is_safe(wheel.name):  # noqa: PLR2004 - PEP 427
        raise ConfigurationError(f"{wheel} is no wheel of segway-ecc (segway_ecc-VERSION-py3-none-any.whl)")
    return parts[1]


def extras_text(extras: Collection[str]) -> str:
    """Extras of a wheel, as pip takes them after its name."""
    return f"[{','.join(sorted(extras))}]" if extras else ""


def build_wheel(folder: Path) -> Path:
    """Build our wheel from this checkout.

    Raises:
        ConfigurationError: This is none, or it cannot be built.
    """
    if not (CHECKOUT / "pyproject.toml").exists():
        raise ConfigurationError("this segway-ecc is installed and no checkout: give the wheel with --wheel FILE")
    done = _pip(["wheel", "--no-deps", "--wheel-dir", str(folder), str(CHECKOUT)])
    built = next(folder.glob(WHEEL), None)
    if done.returncode or built is None:
        raise ConfigurationError(f"the wheel cannot be built: {_last(done.stderr)}")
    return built


def collect(wheel: Path, extras: Collection[str], target: Target, folder: Path, *, refresh: bool) -> list[Path]:
    """Have pip collect all wheels for a robot: from the cache where that has them all, else from the index.

    Raises:
        ConfigurationError: Something has no wheel for it, or the index cannot be reached.
    """
    cache = cache_folder() / "wheels" / target.key
    cache.mkdir(parents=True, exist_ok=True)
    words = ["download", *target.pip_options, "--find-links", str(cache), "--dest", str(folder)]
    what = [f"{wheel.resolve()}{extras_text(extras)}", "pip"]
    done = None if refresh else _pip([*words, "--no-index", *what])
    if done is None or done.returncode:
        done = _from_index([*words, *what], cache)
    if done.returncode:
        raise ConfigurationError(
            f"the wheels for Python {target.python} on {target.machine} cannot be collected: {_last(done.stderr)}"
        )
    found = sorted(folder.glob("*.whl"))
    for path in found:
        if not path.match(WHEEL):
            _keep(path, cache)
    return found


def _from_index(words: Sequence[str], cache: Path) -> subprocess.CompletedProcess[str]:
    """Ask the index; what it has as source only, such as a part of ROS, is built here into the cache."""
    done = _pip(words)
    for _ in range(_MOST_BUILT):
        lacking = _NO_WHEEL.search(done.stderr)
        if not done.returncode or lacking is None:
            break
        with tempfile.TemporaryDirectory(prefix="segway-ecc-wheel-") as folder:
            _pip(["wheel", "--use-pep517", "--no-deps", "--wheel-dir", folder, lacking[1]])
            built = next(Path(folder).glob("*-none-any.whl"), None)  # the same on every machine
            if built is None:
                break
            _keep(built, cache)
        done = _pip(words)
    return done


def _keep(path: Path, cache: Path) -> None:
    kept = cache / path.name
    if not kept.exists():
        new = cache / f".{path.name}.{os.getpid()}"
        shutil.copyfile(path, new)
        new.replace(kept)


def _pip(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "pip", words[0], "--quiet", "--disable-pip-version-check", *words[1:]]
    return subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - no shell is in between


def _last(text: str) -> str:
    lines = [line.removeprefix("ERROR: ") for line in text.splitlines() if line.startswith("ERROR")]
    with contextlib.suppress(IndexError):
        return (lines or text.strip().splitlines())[-1]
    return "pip gives no reason"

# SPDX-License-Identifier: MIT
"""The wheels of a release: ours, and by pip all that it needs on the robot."""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.deploy.release.bundle import WHEEL
from segway_ecc.deploy.release.target import Target
from segway_ecc.node.errors import ConfigurationError

_CHECKOUT: Final = Path(__file__).parents[3]
_NO_WHEEL: Final = re.compile(r"No matching distribution found for ([A-Za-z0-9][^\s;(]*)")
_MOST_BUILT: Final = 8


def build_wheel(folder: Path) -> Path:
    """Build our wheel from this checkout.

    Raises:
        ConfigurationError: This is none, or it cannot be built.
    """
    if not (_CHECKOUT / "pyproject.toml").exists():
        raise ConfigurationError("this segway-ecc is installed and no checkout: give the wheel with --wheel FILE")
    done = _pip(["wheel", "--no-deps", "--wheel-dir", str(folder), str(_CHECKOUT)])
    built = next(folder.glob(WHEEL), None)
    if done.returncode or built is None:
        raise ConfigurationError(f"the wheel cannot be built: {_last(done.stderr)}")
    return built


def collect(wheel: Path, extras: Sequence[str], target: Target, folder: Path, *, refresh: bool) -> list[Path]:
    """Have pip collect all wheels for a robot: from the cache where that has them all, else from the index.

    Raises:
        ConfigurationError: Something has no wheel for it, or the index cannot be reached.
    """
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    cache = caches / "segway-ecc" / "wheels" / target.key
    cache.mkdir(parents=True, exist_ok=True)
    named = f"[{','.join(sorted(extras))}]" if extras else ""
    words = ["download", *target.pip_options, "--find-links", str(cache), "--dest", str(folder)]
    what = [f"{wheel.resolve()}{named}", "pip"]
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

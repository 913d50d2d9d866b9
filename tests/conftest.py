# SPDX-License-Identifier: MIT
"""What the whole test run shares: tests that need more than Python say so, and are never silently left out."""

import importlib.util
import os
import shutil
import signal
from collections import Counter
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import Final

import pytest
from hypothesis import settings

from segway_ecc.deploy.image.recipe import missing as image_lacks
from segway_ecc.hil.kernels import qemu, uml
from segway_ecc.hil.latency.measure import other_host_lacks
from segway_ecc.node.ros.runtime import missing_packages
from tests import command, held_up, ros_processes

# A run is the same every time; how long an example takes says more of the machine than of us.
settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")


@pytest.fixture(autouse=True)
def _end_is_not_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A filter of the kernel would stay with the process of the tests, and all that it starts."""
    monkeypatch.setattr("segway_ecc.node.watchdog.watchdog.hand_over_exits", lambda _sink: None)


def missing_compiler() -> str | None:
    return None if shutil.which("gcc") and shutil.which("g++") else "no gcc or no g++"


def missing_browser() -> str | None:
    there = importlib.util.find_spec("playwright") and Path("/usr/bin/chromium").exists()
    return None if there else "no playwright or no chromium"


def missing_mujoco() -> str | None:
    return None if importlib.util.find_spec("mujoco") else "no mujoco"


def missing_arm64() -> str | None:
    there = shutil.which("aarch64-linux-gnu-gcc") and shutil.which("qemu-aarch64")
    return None if there else "no compiler for arm64 or no qemu-aarch64"


def missing_debuggers() -> str | None:
    return None if shutil.which("gdb") and shutil.which("strace") else "no gdb or no strace"


def missing_urdf_checker() -> str | None:
    return None if shutil.which("check_urdf") else "no check_urdf"


def missing_colcon() -> str | None:
    return None if importlib.util.find_spec("colcon_ros") and importlib.util.find_spec("catkin_pkg") else "no colcon"


NEEDS: dict[str, tuple[Callable[[], str | None], str]] = {
    "arm64": (
        missing_arm64,
        "sudo apt-get install --no-install-recommends gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user",
    ),
    "browser": (missing_browser, "pip install playwright; sudo apt-get install chromium"),
    "colcon": (missing_colcon, "pip install colcon-common-extensions catkin-pkg"),
    "compiler": (missing_compiler, "sudo apt-get install g++"),
    "debuggers": (missing_debuggers, "sudo apt-get install gdb strace"),
    "image": (
        lambda: image_lacks() or uml.available(),
        "sudo apt-get install mmdebstrap e2fsprogs uidmap user-mode-linux",
    ),
    "kernel": (uml.available, "sudo apt-get install user-mode-linux"),
    "rt_kernel": (
        qemu.available,
        "sudo apt-get install --no-install-recommends qemu-system-x86 linux-image-rt-amd64 busybox-static",
    ),
    "systemd": (
        lambda: None if shutil.which("systemd-analyze") else "no systemd-analyze",
        "sudo apt-get install systemd",
    ),
    "namespaces": (other_host_lacks, "run as root; sudo apt-get install iproute2"),
    "mujoco": (missing_mujoco, "pip install mujoco"),
    "urdf": (missing_urdf_checker, "sudo apt-get install liburdfdom-tools"),
    "ros": (lambda: ", ".join(missing_packages()) or None, "pip install 'segway-ecc[ros]', or source an installation"),
}


def required() -> bool:
    """Whether what is missing is a failure: always in CI."""
    return "CI" in os.environ or os.environ.get("SEGWAY_ECC_REQUIRE_ALL") == "1"


def pytest_runtest_setup(item: pytest.Item) -> None:
    for marker, (missing, cure) in NEEDS.items():
        if item.get_closest_marker(marker) is None:
            continue
        lacking = missing()
        if lacking is not None:
            (pytest.fail if required() else pytest.skip)(f"needs {marker}: {lacking}; {cure}")


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their markers
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    _mark_variants(items)
    _check_that_marked_files_are_found(items)


def _mark_variants(items: list[pytest.Item]) -> None:
    """Mark as `variant` what comes behind the first of a test with the marker `variants`."""
    counts = Counter[str]()
    for item in items:
        marker = item.get_closest_marker("variants")
        if marker is None:
            continue
        test = item.nodeid.partition("[")[0]
        counts[test] += 1
        if counts[test] > marker.args[0]:
            item.add_marker("variant")


def _check_that_marked_files_are_found(items: list[pytest.Item]) -> None:
    """The Makefile finds the files of these markers by their text."""
    for marker in ("ros", "real_time", "kernel", "rt_kernel"):
        marked = {item.path for item in items if item.get_closest_marker(marker) is not None}
        hidden = [str(path) for path in sorted(marked) if f"mark.{marker}" not in path.read_text(encoding="utf-8")]
        if hidden:
            raise pytest.UsageError(f"marked {marker} from elsewhere, and so not run by make test: {', '.join(hidden)}")


class LongestFirst:
    """Gives out the files that take longest first, where workers share them, so that none ends long after the others.

    First come files that start a browser or a compiler, then those of `LONG`; in each, those with the most tests.
    """

    KINDS: Final = ("browser", "compiler")
    LONG: Final = tuple(Path(__file__).parent / name for name in ("hil", "deploy/release", "node/replay"))
    """Folders whose tests run whole robots, or install on one."""

    @pytest.hookimpl(trylast=True)  # when every item has its markers, and those that are not run are gone
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        counts = Counter(item.path for item in items)
        ranks = {path: min(map(self._rank, group)) for path, group in groupby(items, lambda item: item.path)}
        items.sort(key=lambda item: (ranks[item.path], -counts[item.path], str(item.path)))

    def _rank(self, item: pytest.Item) -> int:
        if any(map(item.get_closest_marker, self.KINDS)):
            return 0
        return 1 if any(folder in item.path.parents for folder in self.LONG) else 2


def pytest_configure(config: pytest.Config) -> None:
    if not getattr(config.option, "loadscopereorder", True):
        config.pluginmanager.register(LongestFirst())
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell's `&` leaves it; tests send it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    config.pluginmanager.register(held_up)
    config.pluginmanager.register(command)
    config.pluginmanager.register(ros_processes)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = terminalreporter.stats.get("skipped", [])
    for marker, (_, cure) in NEEDS.items():
        names = [report.nodeid for report in skipped if marker in report.keywords]
        if names:
            terminalreporter.write_line(f"left out, needs {marker} ({cure}): {', '.join(names)}", yellow=True)

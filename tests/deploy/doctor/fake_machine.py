# SPDX-License-Identifier: MIT
"""Machines made of a folder of files and of answers, for the doctor to look at."""

import errno
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from segway_ecc.deploy.doctor.check import Finding, Probes, System, Workload, WriteSpeed
from segway_ecc.deploy.support.commands import NoAnswerError
from segway_ecc.firmware_io.links.can_interfaces import UNKNOWN, InterfaceState
from segway_ecc.firmware_io.links.link import LinkState
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.timing import Summary

GOOD_CAN = InterfaceState("can", is_up=True, state=LinkState.ACTIVE, bitrate=500_000, restart_ms=100, tec=0, rec=0)
MS = 1e-3


def lateness(p50_s: float, p99_s: float, max_s: float) -> Summary:
    return Summary(400, p50_s, p50_s, p99_s, max_s, max_s)


GOOD_LATENESS = lateness(0.05 * MS, 0.1 * MS, 0.2 * MS)
GOOD_SPEED = WriteSpeed(20e6, 0.02)


@dataclass
class FakeProbes(Probes):
    """What trying comes to."""

    no_can: bool = False
    exit_filter_error: OSError | None = None
    interfaces: dict[str, InterfaceState] = field(default_factory=dict)
    port_error: OSError | None = None
    lateness: Summary = GOOD_LATENESS
    speed: WriteSpeed = GOOD_SPEED
    write_error: OSError | None = None
    opened: list[str] = field(default_factory=list)
    periods_ns: list[int] = field(default_factory=list)

    def can_socket(self) -> None:
        if self.no_can:
            raise OSError(errno.EAFNOSUPPORT, os.strerror(errno.EAFNOSUPPORT))

    def ask_before_exit(self) -> None:
        if self.exit_filter_error is not None:
            raise self.exit_filter_error

    def interface(self, name: str) -> InterfaceState:
        return self.interfaces.get(name, UNKNOWN)

    def open_port(self, settings: PortSettings) -> None:
        self.opened.append(settings.port)
        if self.port_error is not None:
            raise self.port_error

    def wake_ups(self, period_ns: int) -> Summary:
        self.periods_ns.append(period_ns)
        return self.lateness

    def write(self, folder: Path) -> WriteSpeed:
        assert folder.is_dir()
        if self.write_error is not None:
            raise self.write_error
        return self.speed


@dataclass
class FakeMachine:
    """A machine in the making: its files, what programs answer, and what trying comes to."""

    root: Path
    probes: FakeProbes = field(default_factory=FakeProbes)
    answers: dict[str, str] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    asked: list[Sequence[str]] = field(default_factory=list)
    is_debug_python: bool = False
    processor: str = "x86_64"

    def write(self, files: Mapping[str, str]) -> "FakeMachine":
        for path, text in files.items():
            target = self.root / path.lstrip("/")
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")
        return self

    def remove(self, path: str) -> "FakeMachine":
        (self.root / path.lstrip("/")).unlink()
        return self

    def interface(self, name: str, state: InterfaceState, *, queue: int = 16, is_can: bool = True) -> "FakeMachine":
        """Add a network interface, as /sys and netlink show it."""
        self.probes.interfaces[name] = state
        folder = f"/sys/class/net/{name}"
        flags = "0x40081" if state.is_up else "0x40080"
        kind = "280" if is_can else "1"
        return self.write(
            {f"{folder}/type": f"{kind}\n", f"{folder}/flags": f"{flags}\n", f"{folder}/tx_queue_len": f"{queue}\n"}
        )

    def systemd(self, **units: str) -> "FakeMachine":
        """Have systemd run, with these units; `-` is written `_`."""
        (self.root / "run/systemd/system").mkdir(parents=True, exist_ok=True)
        self.answers |= {f"segway-ecc-{name}": text for name, text in units.items()}
        return self

    def answer(self, words: Sequence[str]) -> str:
        """Answer by the first key that is in the words."""
        self.asked.append(words)
        line = " ".join(words)
        for key, text in self.answers.items():
            if key in line:
                if text.startswith("!"):
                    raise NoAnswerError(text[1:])
                return text
        if words[0] == "systemctl":
            return "LoadState=not-found\n"
        raise NoAnswerError(f"there is no program {words[0]} here")

    @property
    def machine(self) -> System:
        return System(
            self.probes,
            self.root,
            self.answer,
            self.environment,
            python="CPython 3.11.2",
            is_debug_python=self.is_debug_python,
            processor=self.processor,
        )


def workload(
    folder: Path,
    robot: str | None = "cart-can",
    period_ns: int = 5_000_000,
    can: Mapping[str, object] | None = None,
) -> Workload:
    """A packaged robot to run, its CAN settings changed."""
    file = None if robot is None else load_robot(robot)
    if file is not None and can:
        assert isinstance(file.hardware, BusSettings)
        settings = msgspec.structs.replace(file.hardware.can, **can)
        file = msgspec.structs.replace(file, hardware=msgspec.structs.replace(file.hardware, can=settings))
    return Workload(folder / "var/log/segway-ecc", 1000, file, period_ns)


def by_name(findings: Sequence[Finding]) -> dict[str, Finding]:
    found = {finding.name: finding for finding in findings}
    assert len(found) == len(findings), "two findings of one name"
    return found


UNIT = "LoadState=loaded\nUnitFileState=enabled\nActiveState=active\nSubState=running\nNRestarts=0\n"
NODE_UNIT = (
    f"{UNIT}CPUSchedulingPolicy=1\nLimitMEMLOCK=infinity\nAmbientCapabilities=cap_ipc_lock cap_sys_nice\nUser=segway\n"
)


def robot_computer(root: Path) -> FakeMachine:
    """Everything as it should be."""
    fake = FakeMachine(root).interface("can0", GOOD_CAN).systemd(node=NODE_UNIT, guard=UNIT)
    fake.answers |= {"rclpy": "rmw_fastrtps_cpp\n", "timedatectl": "NTP=yes\nNTPSynchronized=yes\n"}
    cpu = "/sys/devices/system/cpu"
    return fake.write(
        {
            "/proc/sys/kernel/osrelease": "6.1.0-40-rt-amd64\n",
            "/proc/sys/kernel/version": "#1 SMP PREEMPT_RT Debian 6.1.153-1 (2025-09-20)\n",
            "/proc/sys/kernel/sched_rt_runtime_us": "950000\n",
            "/proc/sys/kernel/sched_rt_period_us": "1000000\n",
            "/proc/self/timerslack_ns": "50000\n",
            "/proc/self/status": "Name:\tpython\nCapEff:\t0000000000000000\n",
            "/proc/self/limits": "Limit                     Soft Limit           Hard Limit           Units     \n"
            "Max locked memory         8388608              8388608              bytes     \n",
            "/proc/meminfo": "MemTotal:        8000000 kB\nMemFree:         100000 kB\nMemAvailable:    7000000 kB\n",
            "/sys/kernel/realtime": "1\n",
            "/sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc\n",
            "/sys/devices/system/clocksource/clocksource0/available_clocksource": "tsc hpet acpi_pm \n",
            f"{cpu}/cpu0/cpufreq/scaling_governor": "performance\n",
            f"{cpu}/cpu1/cpufreq/scaling_governor": "performance\n",
            f"{cpu}/online": "0-3\n",
            f"{cpu}/isolated": "3\n",
            f"{cpu}/nohz_full": "3\n",
        }
    )


def container(root: Path) -> FakeMachine:
    """A build machine: no CAN, no real-time kernel, no systemd, no ROS, and this user may nothing."""
    fake = FakeMachine(root, FakeProbes(no_can=True))
    fake.answers |= {
        "sched_setscheduler": "!/usr/bin/python3: PermissionError: [Errno 1] Operation not permitted",
        "rclpy": "!python3: ModuleNotFoundError: No module named 'rclpy'",
    }
    return fake.write(
        {
            "/proc/sys/kernel/osrelease": "6.18.44\n",
            "/proc/sys/kernel/version": "#1 SMP PREEMPT_DYNAMIC @0\n",
            "/proc/self/limits": "Max locked memory         8388608              8388608              bytes     \n",
            "/sys/class/net/eth0/type": "1\n",
        }
    )


def raspberry_pi(root: Path, throttled: str = "50005") -> FakeMachine:
    """A robot's computer with a poor supply."""
    fake = robot_computer(root)
    fake.processor = "aarch64"
    return fake.write(
        {
            "/sys/devices/platform/soc/soc:firmware/get_throttled": f"{throttled}\n",
            "/sys/class/thermal/thermal_zone0/temp": "61200\n",
            "/sys/devices/system/clocksource/clocksource0/current_clocksource": "arch_sys_counter\n",
        }
    )

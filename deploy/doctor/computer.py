# SPDX-License-Identifier: MIT
"""The computer itself: kernel, Python, clocks, processors, memory, temperature, power, and the disk of the logs."""

import shutil
from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.check import Finding, System, Workload, bad, good, graded, warning
from segway_ecc.deploy.support.commands import NoAnswerError
from segway_ecc.node.safety.deadlines import LATE_FRACTION

_DEBIAN_NAMES: Final = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "armmp"}
_SLOW_CLOCKS: Final = {"acpi_pm", "jiffies", "refined-jiffies", "pit"}
_CLOCK: Final = "/sys/devices/system/clocksource/clocksource0"
_CPU: Final = "/sys/devices/system/cpu"
_NOTED_FRACTION: Final = 0.1
"""A cycle that starts later than this part of a period after its deadline is counted as late."""
_SLACK_FRACTION: Final = 0.05
_INSTALL: Final = "sudo apt-get install systemd-timesyncd (in an image of ours: --package systemd-timesyncd); "
_THROTTLED: Final = "/sys/devices/platform/soc/soc:firmware/get_throttled"
_CONDITIONS: Final = {0: "under-voltage", 1: "clock rate capped", 2: "throttled", 3: "soft temperature limit"}
"""Of the Raspberry Pi's firmware; 16 bits higher the same since it was switched on."""
_SINCE_START: Final = 16
_HOT_MILLI_C: Final = 80_000
_LITTLE_MIB: Final = 256
_TOO_LITTLE_MIB: Final = 64
_MB: Final = 1_000_000
_SLOW: Final = 2.0
"""MB/s: several times what a robot with raw traffic at 1 kHz writes."""
_SLOW_WAIT_S: Final = 1.0


def check_kernel(machine: System, workload: Workload) -> Iterator[Finding]:
    """Whether the kernel can be interrupted everywhere, has CAN, and asks before a model ends the node."""
    release = machine.read("/proc/sys/kernel/osrelease") or "unknown release"
    build = machine.read("/proc/sys/kernel/version") or ""
    is_real_time = machine.read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in build
    package = f"linux-image-rt-{_DEBIAN_NAMES.get(machine.processor, machine.processor)}"
    yield graded(
        "kernel",
        f"{release}, {'' if is_real_time else 'not '}PREEMPT_RT",
        "under load the kernel itself can delay a cycle by milliseconds",
        f"sudo apt-get install {package} (Debian; elsewhere the distribution's real-time kernel), then start it",
        fits=is_real_time,
    )
    name = "CAN in the kernel"
    try:
        machine.probes.can_socket()
    except OSError as error:
        found = f"socket(AF_CAN): {error.strerror}"
        remedy = "sudo modprobe can-raw; where there is no such module, a kernel with CONFIG_CAN and CONFIG_CAN_RAW"
        effect = "no CAN interface can be used, so the drives are out of reach"
        if workload.needs_socketcan:
            yield bad(name, found, effect, remedy)
        elif workload.robot is None:
            yield warning(name, found, effect, remedy)
        else:
            yield good(name, f"{found}; this robot needs none")
    else:
        yield good(name, "socket(AF_CAN) works")
    yield _exit_filter(machine)


def _exit_filter(machine: System) -> Finding:
    """Whether the model's watchdog is asked before a process ends with status 0; a robot runs without that too."""
    name = "seccomp"
    try:
        machine.probes.ask_before_exit()
    except OSError as error:
        return warning(
            name,
            f"the kernel, or this container, does not have the model's watchdog asked: {error.strerror}",
            "a model that ends the node by a system call of its own with status 0 gives exit code 0; that is reported, "
            "and guard and drives end the torque as ever",
            "Linux 5.9 or later on x86-64 or arm64; in a container a profile that allows the system call seccomp",
        )
    return good(name, "the model's watchdog is asked before the node ends")


def check_python(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Version, and whether it was built for debugging."""
    yield graded(
        "Python",
        f"{machine.python}, a debug build" if machine.is_debug_python else machine.python,
        "each cycle takes several times as long",
        "make the virtual environment with the distribution's python3: python3 -m venv FOLDER",
        fits=not machine.is_debug_python,
    )


def check_timing(machine: System, workload: Workload) -> Iterator[Finding]:
    """From the clock to the wake-up."""
    others = (machine.read(f"{_CLOCK}/available_clocksource") or "").split()
    source = machine.read(f"{_CLOCK}/current_clocksource")
    better = next((name for name in others if name not in {source, *_SLOW_CLOCKS}), None)
    remedy = "see why the kernel takes no better one: sudo dmesg | grep -iE 'clocksource|tsc'"
    if better is not None:
        now = f"echo {better} | sudo tee {_CLOCK}/current_clocksource"
        remedy = f"{now}; for good: clocksource={better} on the kernel's command line"
    effect = "reading the time is slow or coarse, and the loop does it all the time"
    found = source or "not reported by the kernel"
    yield graded("clock source", found, effect, remedy, fits=source not in _SLOW_CLOCKS)
    governors = set(machine.read_all(f"{_CPU}/cpu*/cpufreq/scaling_governor").values())
    yield graded(
        "processor governor",
        ", ".join(sorted(governors)) or "the clock rate of the processors is not changed from here",
        "after a quiet moment the processor is slow, and cycles take longer",
        f"echo performance | sudo tee {_CPU}/cpu*/cpufreq/scaling_governor; "
        "for good: cpufreq.default_governor=performance on the kernel's command line",
        fits=governors <= {"performance"},
    )
    texts = ((machine.read(f"{_CPU}/{name}") or "").strip() for name in ("online", "isolated", "nohz_full"))
    online, isolated, tickless = ("none" if text in {"", "(null)"} else text for text in texts)
    yield good("processors", f"online: {online}; isolated: {isolated}; without tick: {tickless}")
    slack = machine.read("/proc/self/timerslack_ns")
    yield graded(
        "timer slack",
        "not reported by the kernel" if slack is None else f"{int(slack) / 1e3:g} us",
        "without real-time scheduling every cycle may start this much late",
        "allow real-time scheduling, which knows no slack; or TimerSlackNSec=1 in the unit",
        fits=slack is None or int(slack) <= _SLACK_FRACTION * workload.period_ns,
    )
    yield _wake_ups(machine, workload.period_ns)


def check_clock(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Synchronised or not, by systemd or chrony; control itself never reads the wall clock."""
    name = "time synchronisation"
    try:
        lines = machine.answer(["timedatectl", "show"]).splitlines()
        synchronised, nobody_does = "NTPSynchronized=yes" in lines, "CanNTP=no" in lines
    except NoAnswerError:
        try:
            text = machine.answer(["chronyc", "-n", "tracking"])
        except NoAnswerError:
            yield good(name, "not known: neither timedatectl nor chronyc answers")
            return
        synchronised, nobody_does = "Leap status     : Normal" in text, False
    yield graded(
        name,
        "synchronised" if synchronised else "not synchronised",
        "set-points stamped on another machine come early, late or are refused; logs have wrong times",
        f"{_INSTALL if nobody_does else ''}sudo timedatectl set-ntp true; or chrony with the base station as server",
        fits=synchronised,
    )


def _wake_ups(machine: System, period_ns: int) -> Finding:
    measured = machine.probes.wake_ups(period_ns)
    period_s = period_ns * 1e-9
    found = (
        f"at {1.0 / period_s:g} Hz p50 {measured.p50_s * 1e6:.0f} us, p99 {measured.p99_s * 1e6:.0f} us, "
        f"max {measured.max_s * 1e6:.0f} us late, of {measured.count}"
    )
    remedy = "see what else runs (top), allow real-time scheduling, take a PREEMPT_RT kernel, or isolate a processor"
    if measured.p99_s > LATE_FRACTION * period_s:
        return bad("wake-ups", found, "deadlines are missed all the time: the robot would cut its torque", remedy)
    is_late = measured.p99_s > _NOTED_FRACTION * period_s or measured.max_s > LATE_FRACTION * period_s
    return graded("wake-ups", found, "cycles start late; many in a row cut the torque", remedy, fits=not is_late)


def check_board(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Memory everywhere; temperature and power where the machine measures them."""
    lines = (machine.read("/proc/meminfo") or "").splitlines()
    sizes = {name: int(rest.split()[0]) // 1024 for name, _, rest in (line.partition(":") for line in lines) if rest}
    free = sizes.get("MemAvailable")
    found = "not reported by the kernel" if free is None else f"{free} of {sizes.get('MemTotal', 0)} MiB are free"
    remedy = "end what takes it: ps aux --sort=-rss | head; or a computer with more"
    if free is not None and free < _TOO_LITTLE_MIB:
        yield bad("memory", found, "the kernel ends programs, the robot's among them", remedy)
    else:
        fits = free is None or free >= _LITTLE_MIB
        yield graded("memory", found, "ROS and the recorder take about 200 MiB", remedy, fits=fits)
    texts = machine.read_all("/sys/class/thermal/thermal_zone*/temp").values()
    if milli_c := [int(text) for text in texts if text.lstrip("-").isdecimal()]:
        yield graded(
            "temperature",
            f"{max(milli_c) / 1e3:.0f} degrees Celsius",
            "the processor is soon made slower to cool it",
            "a heat sink, a fan, or less to do",
            fits=max(milli_c) < _HOT_MILLI_C,
        )
    throttled = machine.read(_THROTTLED)
    if throttled is None:
        return
    name, bits = "Raspberry Pi power", int(throttled, 16)
    now, before = (
        ", ".join(text for bit, text in _CONDITIONS.items() if found >> bit & 1)
        for found in (bits, bits >> _SINCE_START)
    )
    remedy = "a supply of the board's rated current with a short cable, and a heat sink; vcgencmd get_throttled"
    if now:
        yield bad(name, f"now: {now}", "the processor is slowed down, or the board about to fail", remedy)
    elif before:
        yield warning(name, f"since it was switched on: {before}", "it will come again under load", remedy)
    else:
        yield good(name, "no under-voltage and no throttling since it was switched on")


def check_disk(machine: System, workload: Workload) -> Iterator[Finding]:
    """Where logs go, or the nearest folder above; full or slow it loses logs, and never delays the loop."""
    logs = workload.logs
    folder = next(path for path in (logs, *logs.parents) if path.is_dir())
    free = shutil.disk_usage(folder).free
    yield graded(
        "disk space",
        f"{free / _MB:.0f} MB free for {logs}",
        f"logs may take {workload.log_bytes / _MB:.0f} MB: runs will be recorded in part or not at all",
        f"free some in {folder}, or let logs take less: segway-ecc run --log-limit {max(free // 2 // _MB, 1)}",
        fits=free >= workload.log_bytes,
    )
    try:
        speed = machine.probes.write(folder)
    except OSError as error:
        yield warning(
            "disk speed",
            f"{folder} cannot be written: {error.strerror or error}",
            "runs are not recorded; control is not disturbed",
            f"sudo install -d -o $USER {logs}; or as the robot's user: sudo -u segway segway-ecc deploy doctor",
        )
        return
    yield graded(
        "disk speed",
        f"{speed.bytes_per_s / _MB:.1f} MB/s, slowest wait {speed.slowest_s * 1e3:.0f} ms, in {folder}",
        "the recorder may lose cycles, which the log counts; control is not disturbed",
        "a faster card or disk, or logs elsewhere: segway-ecc run --log FILE",
        fits=speed.bytes_per_s >= _SLOW * _MB and speed.slowest_s <= _SLOW_WAIT_S,
    )

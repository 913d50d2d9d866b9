# SPDX-License-Identifier: MIT
"""Clocks, processors, and how late a loop wakes up."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, graded
from segway_ecc.deploy.doctor.system import NoAnswerError, System, Workload
from segway_ecc.node.safety.deadlines import LATE_FRACTION

_SLOW_CLOCKS: Final = {"acpi_pm", "jiffies", "refined-jiffies", "pit"}
_CLOCK: Final = "/sys/devices/system/clocksource/clocksource0"
_CPU: Final = "/sys/devices/system/cpu"
_NOTED_FRACTION: Final = 0.1
"""A cycle that starts later than this part of a period after its deadline is counted as late."""
_SLACK_FRACTION: Final = 0.05
_INSTALL: Final = "sudo apt-get install systemd-timesyncd (in an image of ours: --package systemd-timesyncd); "


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

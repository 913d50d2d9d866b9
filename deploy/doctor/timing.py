"""Clocks, processors, and how late a loop wakes up."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.system import System, Workload
from segway_ecc.node.safety.deadlines import LATE_FRACTION

_SLOW_CLOCKS: Final = {"acpi_pm", "jiffies", "refined-jiffies", "pit"}
_CLOCK: Final = "/sys/devices/system/clocksource/clocksource0"
_CPU: Final = "/sys/devices/system/cpu"
_NOTED_FRACTION: Final = 0.1
"""A cycle that starts later than this part of a period after its deadline is counted as late."""
_SLACK_FRACTION: Final = 0.05


def check_timing(machine: System, workload: Workload) -> Iterator[Finding]:
    """From the clock to the wake-up."""
    yield _clock_source(machine)
    yield _governor(machine)
    yield _isolated(machine)
    yield _slack(machine, workload)
    yield _wake_ups(machine, workload)


def _clock_source(machine: System) -> Finding:
    source = machine.read(f"{_CLOCK}/current_clocksource")
    if source is None:
        return good("clock source", "the kernel does not tell")
    others = [name for name in (machine.read(f"{_CLOCK}/available_clocksource") or "").split() if name != source]
    better = [name for name in others if name not in _SLOW_CLOCKS]
    if source not in _SLOW_CLOCKS:
        return good("clock source", source)
    if better:
        now = f"echo {better[0]} | sudo tee {_CLOCK}/current_clocksource"
        remedy = f"{now}; for good: clocksource={better[0]} on the kernel's command line"
    else:
        remedy = "see why the kernel takes no better one: sudo dmesg | grep -iE 'clocksource|tsc'"
    effect = "reading the time is slow or coarse, and the loop does it all the time"
    return warning("clock source", source, effect, remedy)


def _governor(machine: System) -> Finding:
    governors = set(machine.read_all(f"{_CPU}/cpu*/cpufreq/scaling_governor").values())
    if not governors:
        return good("processor governor", "the clock rate of the processors is not changed from here")
    if governors == {"performance"}:
        return good("processor governor", "performance")
    return warning(
        "processor governor",
        ", ".join(sorted(governors)),
        "after a quiet moment the processor is slow, and cycles take longer",
        f"echo performance | sudo tee {_CPU}/cpu*/cpufreq/scaling_governor; "
        "for good: cpufreq.default_governor=performance on the kernel's command line",
    )


def _isolated(machine: System) -> Finding:
    online, isolated, tickless = (_processors(machine, name) for name in ("online", "isolated", "nohz_full"))
    return good("processors", f"online: {online}; isolated: {isolated}; without tick: {tickless}")


def _processors(machine: System, name: str) -> str:
    text = (machine.read(f"{_CPU}/{name}") or "").strip()
    return "none" if text in {"", "(null)"} else text


def _slack(machine: System, workload: Workload) -> Finding:
    text = machine.read("/proc/self/timerslack_ns")
    if text is None:
        return good("timer slack", "the kernel does not tell")
    found = f"{int(text) / 1e3:g} us"
    if int(text) <= _SLACK_FRACTION * workload.period_ns:
        return good("timer slack", found)
    return warning(
        "timer slack",
        found,
        "without real-time scheduling every cycle may start this much late",
        "allow real-time scheduling, which knows no slack; or TimerSlackNSec=1 in the unit",
    )


def _wake_ups(machine: System, workload: Workload) -> Finding:
    measured = machine.probes.wake_ups(workload.period_ns)
    period_s = workload.period_ns * 1e-9
    found = (
        f"at {1.0 / period_s:g} Hz p50 {measured.p50_s * 1e6:.0f} us, p99 {measured.p99_s * 1e6:.0f} us, "
        f"max {measured.max_s * 1e6:.0f} us late, of {measured.count}"
    )
    remedy = "see what else runs (top), allow real-time scheduling, take a PREEMPT_RT kernel, or isolate a processor"
    if measured.p99_s > LATE_FRACTION * period_s:
        return bad("wake-ups", found, "deadlines are missed all the time: the robot would cut its torque", remedy)
    if measured.p99_s > _NOTED_FRACTION * period_s or measured.max_s > LATE_FRACTION * period_s:
        return warning("wake-ups", found, "cycles start late; many in a row cut the torque", remedy)
    return good("wake-ups", found)

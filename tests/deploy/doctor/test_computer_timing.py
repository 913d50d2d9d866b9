# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict
from segway_ecc.deploy.doctor.computer import check_timing
from tests.deploy.doctor.fake_machine import MS, FakeMachine, by_name, lateness, workload

CLOCK = "/sys/devices/system/clocksource/clocksource0"
CPU = "/sys/devices/system/cpu"


def looked(fake: FakeMachine, period_ns: int = 5_000_000) -> dict[str, Finding]:
    return by_name(list(check_timing(fake.machine, workload(fake.root, period_ns=period_ns))))


def test_all_is_well(fake: FakeMachine) -> None:
    assert {name: (each.verdict, each.found) for name, each in looked(fake).items()} == {
        "clock source": (Verdict.GOOD, "tsc"),
        "processor governor": (Verdict.GOOD, "performance"),
        "processors": (Verdict.GOOD, "online: 0-3; isolated: 3; without tick: 3"),
        "timer slack": (Verdict.GOOD, "50 us"),
        "wake-ups": (Verdict.GOOD, "at 200 Hz p50 50 us, p99 100 us, max 200 us late, of 400"),
    }
    assert fake.probes.periods_ns == [5_000_000]


@pytest.mark.parametrize("source", ["acpi_pm", "jiffies", "refined-jiffies"])
def test_a_slow_clock(fake: FakeMachine, source: str) -> None:
    fake.write({f"{CLOCK}/current_clocksource": f"{source}\n", f"{CLOCK}/available_clocksource": "acpi_pm hpet \n"})
    found = looked(fake)["clock source"]
    assert (found.verdict, found.found) == (Verdict.WARNING, source)
    assert found.remedy.startswith("echo hpet | sudo tee /sys/devices/system/clocksource/")


def test_a_slow_clock_and_no_other(fake: FakeMachine) -> None:
    fake.write({f"{CLOCK}/current_clocksource": "jiffies\n", f"{CLOCK}/available_clocksource": "jiffies acpi_pm\n"})
    assert "dmesg" in looked(fake)["clock source"].remedy


@pytest.mark.parametrize("source", ["hpet", "arch_sys_counter", "kvm-clock"])
def test_other_clocks_will_do(fake: FakeMachine, source: str) -> None:
    fake.write({f"{CLOCK}/current_clocksource": f"{source}\n"})
    assert looked(fake)["clock source"].verdict is Verdict.GOOD


def test_one_processor_that_saves_power_is_enough(fake: FakeMachine) -> None:
    fake.write({f"{CPU}/cpu1/cpufreq/scaling_governor": "schedutil\n"})
    found = looked(fake)["processor governor"]
    assert (found.verdict, found.found) == (Verdict.WARNING, "performance, schedutil")
    assert "echo performance | sudo tee" in found.remedy


def test_what_the_machine_does_not_have_is_no_reproach(fake: FakeMachine) -> None:
    for path in (f"{CLOCK}/current_clocksource", "/proc/self/timerslack_ns", f"{CPU}/online", f"{CPU}/isolated"):
        fake.remove(path)
    for processor in ("cpu0", "cpu1"):
        fake.remove(f"{CPU}/{processor}/cpufreq/scaling_governor")
    fake.write({f"{CPU}/nohz_full": "  (null)\n"})
    found = looked(fake)
    assert {each.verdict for each in found.values()} == {Verdict.GOOD}
    assert found["processors"].found == "online: none; isolated: none; without tick: none"


@pytest.mark.parametrize(("slack_us", "verdict"), [(250, Verdict.GOOD), (251, Verdict.WARNING)])
def test_slack_is_measured_by_the_period(fake: FakeMachine, slack_us: int, verdict: Verdict) -> None:
    fake.write({"/proc/self/timerslack_ns": f"{slack_us * 1000}\n"})
    assert looked(fake)["timer slack"].verdict is verdict


@pytest.mark.parametrize(
    ("p99_ms", "max_ms", "verdict"),
    [
        (0.49, 2.4, Verdict.GOOD),
        (0.51, 0.6, Verdict.WARNING),
        (0.1, 2.6, Verdict.WARNING),
        (2.6, 3.0, Verdict.BAD),
    ],
)
def test_wake_ups(fake: FakeMachine, p99_ms: float, max_ms: float, verdict: Verdict) -> None:
    fake.probes.lateness = lateness(0.05 * MS, p99_ms * MS, max_ms * MS)
    assert looked(fake)["wake-ups"].verdict is verdict


def test_wake_ups_are_measured_by_the_period(fake: FakeMachine) -> None:
    fake.probes.lateness = lateness(0.05 * MS, 0.51 * MS, 0.6 * MS)
    assert looked(fake, 10_000_000)["wake-ups"].verdict is Verdict.GOOD

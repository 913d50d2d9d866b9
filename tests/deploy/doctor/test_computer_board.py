# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict
from segway_ecc.deploy.doctor.computer import check_board
from tests.deploy.doctor.fake_machine import FakeMachine, by_name, raspberry_pi, workload


def looked(fake: FakeMachine) -> dict[str, Finding]:
    return by_name(list(check_board(fake.machine, workload(fake.root))))


def test_all_is_well(fake: FakeMachine) -> None:
    found = looked(fake)
    assert list(found) == ["memory"]
    assert (found["memory"].verdict, found["memory"].found) == (Verdict.GOOD, "6835 of 7812 MiB are free")


@pytest.mark.parametrize(
    ("mib", "verdict"), [(63, Verdict.BAD), (64, Verdict.WARNING), (255, Verdict.WARNING), (256, Verdict.GOOD)]
)
def test_memory(fake: FakeMachine, mib: int, verdict: Verdict) -> None:
    fake.write({"/proc/meminfo": f"MemTotal: 1000000 kB\nMemAvailable:    {mib * 1024} kB\nHugePages_Total:   0\n"})
    assert looked(fake)["memory"].verdict is verdict


def test_memory_not_reported_by_the_kernel_is_good(fake: FakeMachine) -> None:
    fake.remove("/proc/meminfo")
    assert looked(fake)["memory"].found == "not reported by the kernel"


@pytest.mark.parametrize(("milli", "verdict"), [(79_999, Verdict.GOOD), (80_000, Verdict.WARNING)])
def test_the_hottest_zone_counts(fake: FakeMachine, milli: int, verdict: Verdict) -> None:
    zones = {f"/sys/class/thermal/thermal_zone{n}/temp": text for n, text in enumerate(["-5000\n", f"{milli}\n", "x"])}
    found = looked(fake.write(zones))["temperature"]
    assert (found.verdict, found.found) == (verdict, "80 degrees Celsius")


@pytest.mark.parametrize(
    ("throttled", "verdict", "text"),
    [
        ("0", Verdict.GOOD, "no under-voltage and no throttling since it was switched on"),
        ("50000", Verdict.WARNING, "since it was switched on: under-voltage, throttled"),
        ("80000", Verdict.WARNING, "since it was switched on: soft temperature limit"),
        ("50005", Verdict.BAD, "now: under-voltage, throttled"),
        ("20002", Verdict.BAD, "now: clock rate capped"),
    ],
)
def test_a_raspberry_pi(tmp_path: Path, throttled: str, verdict: Verdict, text: str) -> None:
    found = looked(raspberry_pi(tmp_path, throttled))["Raspberry Pi power"]
    assert (found.verdict, found.found) == (verdict, text)

# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.doctor.check import Verdict
from segway_ecc.deploy.doctor.computer import check_clock
from tests.deploy.doctor.fake_machine import FakeMachine, workload

CHRONY = "Reference ID    : 0A000001 (10.0.0.1)\nStratum         : 3\nLeap status     : {}\n"


@pytest.mark.parametrize(
    ("answers", "verdict", "text"),
    [
        ({"timedatectl": "NTP=yes\nNTPSynchronized=yes\n"}, Verdict.GOOD, "synchronised"),
        ({"timedatectl": "NTP=yes\nNTPSynchronized=no\n"}, Verdict.WARNING, "not synchronised"),
        ({"timedatectl": "!no bus", "chronyc": CHRONY.format("Normal")}, Verdict.GOOD, "synchronised"),
        ({"timedatectl": "!no bus", "chronyc": CHRONY.format("Not synchronised")}, Verdict.WARNING, "not synchronised"),
        ({}, Verdict.GOOD, "not known: neither timedatectl nor chronyc answers"),
    ],
)
def test_the_wall_clock(fake: FakeMachine, answers: dict[str, str], verdict: Verdict, text: str) -> None:
    fake.answers = answers
    (found,) = check_clock(fake.machine, workload(fake.root))
    assert (found.verdict, found.found) == (verdict, text)


def test_machine_without_time_service_is_warned_with_install_command(fake: FakeMachine) -> None:
    """As timedatectl of systemd 252 prints where no service for it is installed; set-ntp alone would be refused."""
    fake.answers = {"timedatectl": "Timezone=Etc/UTC\nLocalRTC=no\nCanNTP=no\nNTP=no\nNTPSynchronized=no\n"}
    (found,) = check_clock(fake.machine, workload(fake.root))
    assert found.remedy.startswith("sudo apt-get install systemd-timesyncd")
    fake.answers = {"timedatectl": "CanNTP=yes\nNTP=no\nNTPSynchronized=no\n"}
    (found,) = check_clock(fake.machine, workload(fake.root))
    assert found.remedy.startswith("sudo timedatectl set-ntp true")

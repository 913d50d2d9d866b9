"""Whether this machine's wall clock is that of the others."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, good, warning
from segway_ecc.deploy.doctor.system import NoAnswerError, System, Workload

_INSTALL: Final = "sudo apt-get install systemd-timesyncd (in an image of ours: --package systemd-timesyncd); "


def check_clock(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Synchronised or not, as systemd or chrony says; control itself never reads the wall clock."""
    try:
        lines = machine.answer(["timedatectl", "show"]).splitlines()
        synchronised, nobody_does = "NTPSynchronized=yes" in lines, "CanNTP=no" in lines
    except NoAnswerError:
        try:
            text = machine.answer(["chronyc", "-n", "tracking"])
        except NoAnswerError:
            yield good("time synchronisation", "not known: neither timedatectl nor chronyc answers")
            return
        synchronised, nobody_does = "Leap status     : Normal" in text, False
    if synchronised:
        yield good("time synchronisation", "synchronised")
    else:
        yield warning(
            "time synchronisation",
            "not synchronised",
            "set-points stamped on another machine come early, late or are refused; logs bear wrong times",
            f"{_INSTALL if nobody_does else ''}sudo timedatectl set-ntp true; "
            "or chrony with the base station as its server",
        )

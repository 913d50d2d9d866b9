"""Whether this machine's wall clock is that of the others."""

from collections.abc import Iterator

from deploy.doctor.finding import Finding, good, warning
from deploy.doctor.system import Job, Machine, NoAnswerError


def check_clock(machine: Machine, _job: Job) -> Iterator[Finding]:
    """Synchronised or not, as systemd or chrony says; control itself never reads the wall clock."""
    try:
        text = machine.answer(["timedatectl", "show"])
        synchronised = "NTPSynchronized=yes" in text.splitlines()
    except NoAnswerError:
        try:
            text = machine.answer(["chronyc", "-n", "tracking"])
        except NoAnswerError:
            yield good("time synchronisation", "not known: neither timedatectl nor chronyc answers")
            return
        synchronised = "Leap status     : Normal" in text
    if synchronised:
        yield good("time synchronisation", "synchronised")
    else:
        yield warning(
            "time synchronisation",
            "not synchronised",
            "set-points stamped on another machine come early, late or are refused; logs bear wrong times",
            "sudo timedatectl set-ntp true; or chrony with the base station as its server",
        )

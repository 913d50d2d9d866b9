"""The Python that runs the loop."""

from collections.abc import Iterator

from segway_ecc.deploy.doctor.finding import Finding, good, warning
from segway_ecc.deploy.doctor.system import System, Workload


def check_python(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Version, and whether it was built for debugging."""
    if machine.is_debug_python:
        yield warning(
            "Python",
            f"{machine.python}, a debug build",
            "each cycle takes several times as long",
            "make the virtual environment with the distribution's python3: python3 -m venv FOLDER",
        )
    else:
        yield good("Python", machine.python)

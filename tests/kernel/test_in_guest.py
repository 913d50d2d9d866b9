"""Runs the files of tests/kernel/guest in user-mode Linux, all in one boot, and tells their results one by one."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from hil.kernels.uml import run_in_guest

ROOT = Path(__file__).parents[2]
GUEST = Path("tests/kernel/guest")
FILES = sorted(path.stem for path in (ROOT / GUEST).glob("test_*.py"))
BOOT_AND_TESTS_S = 840.0

pytestmark = [pytest.mark.kernel, pytest.mark.timeout(900)]


@dataclass(frozen=True)
class GuestRun:
    cases: tuple[ET.Element, ...]
    output: str

    def of_file(self, stem: str) -> Iterator[ET.Element]:
        module = ".".join([*GUEST.parts, stem])
        for case in self.cases:
            # A file that could not be imported is one case without a class name.
            name = f"{case.get('classname', '')}.{case.get('name', '')}".lstrip(".")
            if name == module or name.startswith(f"{module}."):
                yield case


@pytest.fixture(scope="session")
def guest_run(tmp_path_factory: pytest.TempPathFactory) -> GuestRun:
    results = tmp_path_factory.mktemp("guest")
    report = results / "guest.xml"
    options = [f"--junitxml={report}", "--continue-on-collection-errors", "-p", "no:cacheprovider"]
    outcome = run_in_guest(
        [sys.executable, "-m", "pytest", str(GUEST), *options, "--basetemp=/run/pytest"],
        cwd=ROOT,
        interfaces=("vcan0", "vcan1"),
        environment={"SEGWAY_ECC_IN_GUEST": "1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        timeout_s=BOOT_AND_TESTS_S,
        results=results,
    )
    assert report.exists(), f"pytest in the guest wrote no report (status {outcome.exit_status}):\n{outcome.output}"
    cases = ET.parse(report).iter("testcase")  # noqa: S314 - our own pytest wrote it a moment ago
    return GuestRun(tuple(cases), outcome.output)


def failure(case: ET.Element) -> str | None:
    for kind in ("failure", "error"):
        found = case.find(kind)
        if found is not None:
            return f"{case.get('name')}: {found.text or found.get('message')}"
    return None


@pytest.mark.parametrize("stem", FILES)
def test_file_passes_in_the_guest(stem: str, guest_run: GuestRun) -> None:
    cases = list(guest_run.of_file(stem))
    failures = [text for text in map(failure, cases) if text is not None]
    if failures:
        pytest.fail("\n\n".join(failures), pytrace=False)
    if all(case.find("skipped") is not None for case in cases):
        pytest.fail(
            f"no test of {GUEST / stem}.py was run in the guest, which said:\n{guest_run.output}", pytrace=False
        )

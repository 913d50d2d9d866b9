# SPDX-License-Identifier: MIT
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from segway_ecc.hil.kernels.guest import GuestResult

ROOT = Path(__file__).parents[2]
# The files in these folders need the CAN of a guest: test_in_guest.py and test_in_rt_guest.py run them there, and set
# this variable.
IN_GUEST = "SEGWAY_ECC_IN_GUEST"
collect_ignore = [] if IN_GUEST in os.environ else ["guest", "rt_guest"]

RunInGuest = Callable[[Sequence[str], dict[str, str], Path], GuestResult]


@dataclass(frozen=True)
class GuestRun:
    """What pytest in a guest told of the test files in a folder."""

    folder: Path
    cases: tuple[ET.Element, ...]
    output: str

    def check(self, stem: str) -> None:
        """Fail as the file's tests failed, or where none of them was run."""
        cases = list(self._of_file(stem))
        failures = [text for text in map(failure, cases) if text is not None]
        if failures:
            pytest.fail("\n\n".join(failures), pytrace=False)
        if all(case.find("skipped") is not None for case in cases):
            file = self.folder / f"{stem}.py"
            pytest.fail(f"no test of {file} was run in the guest, which said:\n{self.output}", pytrace=False)

    def _of_file(self, stem: str) -> Iterator[ET.Element]:
        module = ".".join([*self.folder.parts, stem])
        for case in self.cases:
            # A file that could not be imported is one case without a class name.
            name = f"{case.get('classname', '')}.{case.get('name', '')}".lstrip(".")
            if name == module or name.startswith(f"{module}."):
                yield case


def failure(case: ET.Element) -> str | None:
    for kind in ("failure", "error"):
        found = case.find(kind)
        if found is not None:
            return f"{case.get('name')}: {found.text or found.get('message')}"
    return None


@pytest.fixture(scope="session")
def check_in_guest(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path, RunInGuest], Callable[[str], None]]:
    """Runs the test files of a folder in one boot of a guest, and returns what tells how one of them went."""

    def check_folder(folder: Path, run: RunInGuest) -> Callable[[str], None]:
        results = tmp_path_factory.mktemp(folder.name)
        report = results / "report.xml"
        options = [f"--junitxml={report}", "--continue-on-collection-errors", "-p", "no:cacheprovider"]
        command = [sys.executable, "-P", "-m", "pytest", str(folder), *options, "--basetemp=/run/pytest"]
        outcome = run(command, {IN_GUEST: "1"}, results)
        assert report.exists(), f"pytest in the guest wrote no report (status {outcome.exit_status}):\n{outcome.output}"
        cases = ET.parse(report).iter("testcase")  # noqa: S314 - our own pytest wrote it a moment ago
        return GuestRun(folder, tuple(cases), outcome.output).check

    return check_folder

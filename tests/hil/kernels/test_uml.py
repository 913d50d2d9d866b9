# SPDX-License-Identifier: MIT
import os
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from segway_ecc.hil.kernels.guest import GuestError, GuestResult
from segway_ecc.hil.kernels.uml import available, main, run_in_guest
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[3]
SCRIPT = """
echo "greeting=$GREETING home=$HOME here=$(pwd)"
echo leaked > leaked-by-the-guest && cat leaked-by-the-guest
echo kept > "$KEEP/result.txt"
printf 'no newline'
exit 3
"""

pytestmark = pytest.mark.kernel


@dataclass(frozen=True)
class Visit:
    result: GuestResult
    results: Path
    streamed: str


@pytest.fixture(scope="module")
def visit(tmp_path_factory: pytest.TempPathFactory) -> Visit:
    results = tmp_path_factory.mktemp("visit") / "made by the call"
    streamed: list[str] = []
    result = run_in_guest(
        ["sh", "-c", SCRIPT],
        cwd=ROOT / "tests",
        environment={"GREETING": "it's $5", "KEEP": str(results)},
        results=results,
        on_output=streamed.append,
    )
    return Visit(result, results, "".join(streamed))


def guest_processes() -> set[int]:
    """Return every process of the guests that this test started, by their process group."""
    parents, groups = {}, {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rsplit(")", 1)[1].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        pid = int(entry.parent.name)
        parents[pid], groups[pid] = int(fields[1]), int(fields[2])
    leaders = {pid for pid, parent in parents.items() if parent == os.getpid() and groups[pid] == pid}
    return {pid for pid, group in groups.items() if group in leaders}


def test_the_exit_status_is_the_commands(visit: Visit) -> None:
    assert visit.result.exit_status == 3


def test_environment_and_folder_arrive(visit: Visit) -> None:
    assert visit.result.output.startswith(f"greeting=it's $5 home=/run/home here={ROOT / 'tests'}\n")


def test_the_output_is_the_commands_alone_and_streamed(visit: Visit) -> None:
    assert visit.result.output.endswith("\nleaked\nno newline")
    assert visit.streamed == visit.result.output


def test_what_the_guest_writes_does_not_reach_the_hosts_files(visit: Visit) -> None:
    assert "\nleaked\n" in visit.result.output
    assert not (ROOT / "tests" / "leaked-by-the-guest").exists()


def test_the_results_folder_is_the_hosts(visit: Visit) -> None:
    assert (visit.results / "result.txt").read_text() == "kept\n"


def test_the_command_line_makes_the_interfaces(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--interface", "vcan0", "--interface", "vcan7", "--timeout", str(PATIENCE_S)]

    assert main([*options, "--", "ls", "/sys/class/net"]) == 0
    assert {"lo", "vcan0", "vcan7"} <= set(capsys.readouterr().out.split())


def test_out_of_time_ends_every_process() -> None:
    seen: set[int] = set()

    # The time is up once the command runs, however long the boot takes on this machine.
    with pytest.raises(GuestError, match=r"killed after 300 s(.|\n)*started"):
        run_in_guest(
            ["sh", "-c", "sleep 900 & echo started; sleep 900"],
            cwd=ROOT,
            timeout_s=PATIENCE_S,
            on_output=lambda _: seen.update(guest_processes()),
            clock=lambda: time.monotonic() + (PATIENCE_S if seen else 0.0),
        )

    assert len(seen) > 1
    assert [pid for pid in seen if Path(f"/proc/{pid}").exists()] == []


def test_a_guest_that_ends_without_a_status_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    cut_the_power = "echo last words; echo o > /proc/sysrq-trigger; sleep 60"

    assert main(["--", "sh", "-c", cut_the_power]) == 125
    error = capsys.readouterr().err
    assert "without the command's exit status" in error
    assert "last words" in error


def test_a_missing_program_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))

    assert available() == "linux.uml is not installed: sudo apt-get install user-mode-linux"
    with pytest.raises(GuestError, match=r"No guest can run here: linux\.uml is not installed"):
        run_in_guest(["true"], cwd=tmp_path)


def test_memory_that_fits_nowhere_is_refused(tmp_path: Path) -> None:
    with pytest.raises(GuestError, match=r"memory of \d+ MiB fits neither .* set TMPDIR"):
        run_in_guest(["true"], cwd=tmp_path, memory_mib=1 << 30)


@pytest.mark.parametrize("arguments", [[], ["true"], ["--timeout", "5", "--"]])
def test_a_command_line_without_a_command_is_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refusal:
        main(arguments)

    assert refusal.value.code == 2
    assert "then --, then the command" in capsys.readouterr().err

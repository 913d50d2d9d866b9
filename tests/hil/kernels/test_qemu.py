# SPDX-License-Identifier: MIT
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.kernels import qemu
from segway_ecc.hil.kernels.guest import GuestError, GuestResult, to_stdout
from segway_ecc.hil.kernels.qemu import available, main, run_in_guest
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[3]
SCRIPT = """
echo "greeting=$GREETING home=$HOME here=$(pwd)"
echo leaked > leaked-by-the-guest && cat leaked-by-the-guest
echo kept > "$KEEP/result.txt"
ip -json -details link show type can > "$KEEP/links.json"
cp /sys/kernel/realtime "$KEEP/realtime"
nproc > "$KEEP/processors"
cp /proc/sys/kernel/panic_on_oops "$KEEP/panic_on_oops"
printf 'no newline'
exit 3
"""


@dataclass(frozen=True)
class Visit:
    result: GuestResult
    results: Path
    streamed: str


@pytest.fixture(scope="module")
def visit(tmp_path_factory: pytest.TempPathFactory) -> Visit:
    results = tmp_path_factory.mktemp("visit") / "made by, the call"
    streamed: list[str] = []
    result = run_in_guest(
        ["sh", "-c", SCRIPT],
        cwd=ROOT / "tests",
        bitrate=250_000,
        environment={"GREETING": "it's $5", "KEEP": str(results)},
        results=results,
        on_output=streamed.append,
    )
    return Visit(result, results, "".join(streamed))


def emulators(results: Path) -> list[int]:
    """Return the processes of the guest that has this results folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if words.startswith(b"qemu-system") and str(results).encode() in words:
            found.append(int(entry.parent.name))
    return found


def in_time(holds: Callable[[], bool]) -> bool:
    end_s = time.monotonic() + PATIENCE_S
    while not holds():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.rt_kernel
def test_the_exit_status_is_the_commands(visit: Visit) -> None:
    assert visit.result.exit_status == 3


@pytest.mark.rt_kernel
def test_environment_and_folder_arrive(visit: Visit) -> None:
    assert visit.result.output.startswith(f"greeting=it's $5 home=/run/home here={ROOT / 'tests'}\n")


@pytest.mark.rt_kernel
def test_the_output_is_the_commands_alone_and_streamed(visit: Visit) -> None:
    assert visit.result.output.endswith("\nleaked\nno newline")
    assert visit.streamed == visit.result.output


@pytest.mark.rt_kernel
def test_what_the_guest_writes_does_not_reach_the_hosts_files(visit: Visit) -> None:
    assert "\nleaked\n" in visit.result.output
    assert not (ROOT / "tests" / "leaked-by-the-guest").exists()


@pytest.mark.rt_kernel
def test_the_results_folder_is_the_hosts(visit: Visit) -> None:
    assert (visit.results / "result.txt").read_text() == "kept\n"


@pytest.mark.rt_kernel
def test_the_machine_is_what_was_asked_for(visit: Visit) -> None:
    links = json.loads((visit.results / "links.json").read_text())

    assert (visit.results / "realtime").read_text() == "1\n"
    assert (visit.results / "processors").read_text() == "2\n"
    assert (visit.results / "panic_on_oops").read_text() == "1\n"
    assert [(link["ifname"], link["txqlen"], "UP" in link["flags"]) for link in links] == [
        ("can0", 16, True),
        ("can1", 16, True),
    ]
    for link in links:
        controller = link["linkinfo"]["info_data"]
        assert controller["bittiming"]["bitrate"] == 250_000
        assert controller["restart_ms"] == 100
        assert controller["ctrlmode"] == ["BERR-REPORTING"]


@pytest.mark.rt_kernel
def test_out_of_time_ends_the_guest(tmp_path: Path) -> None:
    with pytest.raises(GuestError, match="The guest was killed after 2 s, unfinished"):
        run_in_guest(["sleep", "900"], cwd=ROOT, timeout_s=2.0, results=tmp_path)

    assert emulators(tmp_path) == []


@pytest.mark.rt_kernel
def test_the_guest_does_not_outlive_the_process_that_started_it(tmp_path: Path) -> None:
    words = [
        sys.executable,
        "-P",
        "-m",
        "segway_ecc.hil.kernels.qemu",
        "--results",
        str(tmp_path),
        "--",
        "sleep",
        "900",
    ]
    # Killed, it leaves its scratch folder behind.
    with subprocess.Popen(words, cwd=ROOT, env={**os.environ, "TMPDIR": str(tmp_path)}) as caller:
        started = in_time(lambda: bool(emulators(tmp_path)))
        caller.kill()

    assert started
    assert in_time(lambda: not emulators(tmp_path))


@pytest.mark.rt_kernel
def test_a_kernel_that_panics_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--", "sh", "-c", "echo last words; echo c > /proc/sysrq-trigger"]) == 125
    error = capsys.readouterr().err
    assert "without the command's exit status" in error
    assert "last words" in error
    assert "Kernel panic - not syncing: sysrq triggered crash" in error


@pytest.mark.rt_kernel
def test_an_interface_that_cannot_be_set_up_is_reported() -> None:
    with pytest.raises(GuestError, match=r"its set-up failed(.|\n)*can0: could not be set up at 7 bit/s"):
        run_in_guest(["true"], cwd=ROOT, bitrate=7)


def fake_machine(folder: Path, monkeypatch: pytest.MonkeyPatch, busybox: bytes) -> None:
    """Lets there be every program, and no kernel."""
    for name in ("qemu-system-x86_64", "busybox", "ip", "setpriv"):
        (folder / name).write_bytes(busybox)
        (folder / name).chmod(0o755)
    monkeypatch.setattr(qemu, "search_path", lambda: str(folder))
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setattr(qemu, "_KERNELS", folder / "boot")
    monkeypatch.setattr(qemu, "_MODULES", folder / "modules")


def elf(*segment_types: int) -> bytes:
    """The header of a 64-bit ELF program as elf(5) has it, with these program headers."""
    head = bytearray(64)
    head[32], head[54], head[56] = 64, 56, len(segment_types)
    return bytes(head) + b"".join(kind.to_bytes(4, "little") + bytes(52) for kind in segment_types)


def install_kernel(folder: Path, version: str) -> Path:
    kernel = folder / "boot" / f"vmlinuz-{version}-rt-amd64"
    modules = folder / "modules" / f"{version}-rt-amd64"
    kernel.parent.mkdir(exist_ok=True)
    modules.mkdir(parents=True)
    kernel.touch()
    (modules / "modules.dep").touch()
    return kernel


STATIC, DYNAMIC = elf(1, 1, 4), elf(6, 3, 1)


def test_a_machine_that_has_everything_lacks_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fake_machine(tmp_path, monkeypatch, STATIC)
    install_kernel(tmp_path, "6.1.0-56")

    assert available() is None


def test_all_that_is_missing_is_named_with_one_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fake_machine(tmp_path, monkeypatch, STATIC)
    (tmp_path / "qemu-system-x86_64").unlink()
    (tmp_path / "busybox").unlink()

    missing = available()

    assert missing == (
        f"not installed: qemu-system-x86_64, busybox, {tmp_path}/boot/vmlinuz-*-rt-amd64 (readable, with its modules): "
        "sudo apt-get install --no-install-recommends qemu-system-x86 busybox-static linux-image-rt-amd64"
    )
    with pytest.raises(GuestError, match="No guest can run here: not installed: qemu-system-x86_64"):
        run_in_guest(["true"], cwd=tmp_path)


def test_a_busybox_that_needs_libraries_will_not_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fake_machine(tmp_path, monkeypatch, DYNAMIC)
    install_kernel(tmp_path, "6.1.0-56")

    missing = available()

    assert missing is not None
    assert "a busybox that needs no libraries" in missing
    assert missing.endswith("busybox-static")


def test_a_kernel_without_its_modules_will_not_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fake_machine(tmp_path, monkeypatch, STATIC)
    install_kernel(tmp_path, "6.1.0-56")
    (tmp_path / "modules" / "6.1.0-56-rt-amd64" / "modules.dep").unlink()

    missing = available()

    assert missing is not None
    assert missing.endswith("linux-image-rt-amd64")


def test_the_newest_kernel_is_taken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    fake_machine(tmp_path, monkeypatch, STATIC)
    kernels = [install_kernel(tmp_path, version) for version in ("6.1.0-9", "6.12.1-1", "6.1.0-56", "6.9.0-1")]

    assert qemu._newest_kernel() == kernels[1]


def test_the_command_line_sets_what_to_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls: list[tuple[Sequence[str], dict[str, Any]]] = []

    def run(command: Sequence[str], **settings: Any) -> GuestResult:
        calls.append((command, settings))
        return GuestResult(137, "")

    monkeypatch.setattr(qemu, "run_in_guest", run)
    options = ["--bitrate", "125000", "--timeout", "60", "--results", str(tmp_path)]

    assert main([*options, "--", "sh", "-c", "kill -KILL $$", "--", "x"]) == 137
    ((command, settings),) = calls
    assert command == ["sh", "-c", "kill -KILL $$", "--", "x"]
    assert settings == {
        "cwd": Path.cwd(),
        "bitrate": 125_000,
        "timeout_s": 60.0,
        "results": tmp_path,
        "on_output": to_stdout,
    }


@pytest.mark.parametrize("arguments", [[], ["true"], ["--timeout", "5", "--"], ["--interface", "vcan0", "--", "true"]])
def test_a_command_line_without_a_command_is_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refusal:
        main(arguments)

    assert refusal.value.code == 2
    assert "then --, then the command" in capsys.readouterr().err

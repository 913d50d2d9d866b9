# SPDX-License-Identifier: MIT
"""Runs a command in QEMU, on Debian's PREEMPT_RT kernel with two CAN controllers on one bus.

The machine is emulated, so nothing is asked of the host's processor or kernel. The controllers are SJA1000, on Kvaser
PCI cards, driven by the kernel's own kvaser_pci and sja1000 as real ones are: can0 and can1. The guest sees the host's
files, so the same virtual environment and checkout run inside, but what it writes stays in its memory: only the
results folder is the host's own. Also a command:

    python -P -m segway_ecc.hil.kernels.qemu --bitrate 500000 --timeout 60 -- python -m pytest tests/kernel/rt_guest

What the emulated bus does not do: it has no bit timing, no arbitration and no errors. A frame is on the other
controller at once and counts as sent even where no other controller is up, so the state stays error-active and the
error counters at zero; error frames come of a receive buffer that ran over, and of nothing else. A remote frame with a
DLC above 0 puts the receiving controller's buffer out of step, and spoils what it receives afterwards. What can be had
of a real adapter is that it goes: unbind and bind, in /sys/bus/pci/drivers/kvaser_pci, take it away and bring it back.
"""

import argparse
import lzma
import os
import re
import shutil
import stat
import struct
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple, Unpack

from segway_ecc.hil.kernels.guest import (
    GuestError,
    GuestOptions,
    GuestResult,
    command_line,
    missing_programs,
    prepared_task,
    run_task,
    script,
    search_path,
)

_ALIGNMENT = 4
_PROGRAM_INTERPRETER = 3
"""PT_INTERP of elf.h: the segment that a program has which needs the host's libraries."""
FOLDER: Final = stat.S_IFDIR | 0o755
PROGRAM: Final = stat.S_IFREG | 0o755
FILE: Final = stat.S_IFREG | 0o644
SYMBOLIC_LINK: Final = stat.S_IFLNK | 0o777
"""What entries are, as in `st_mode`: all can read them, and run programs."""
_PACKAGES = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "ip": "iproute2",
    "setpriv": "util-linux",
}
_KERNEL_PACKAGE = "linux-image-rt-amd64"
_KERNELS, _MODULES = Path("/boot"), Path("/lib/modules")
_KERNEL_NAME = "vmlinuz-*-rt-amd64"
_NEEDED_MODULES = ("virtio_pci", "9p", "9pnet_virtio", "overlay", "can-raw", "kvaser_pci")


class ArchiveEntry(NamedTuple):
    """A file of the archive: its path, its type and permissions as in `st_mode`, and its content or link's target."""

    path: str
    mode: int
    content: bytes = b""


def cpio_archive(entries: Iterable[ArchiveEntry]) -> bytes:
    """Pack entries as the kernel unpacks its first file system.

    The format is the one that the kernel calls newc: its Documentation/driver-api/early-userspace/buffer-format.rst.
    """
    packed = bytearray()
    for inode, entry in enumerate([*entries, ArchiveEntry("TRAILER!!!", 0)], start=1):
        name = entry.path.encode() + b"\0"
        # Inode, mode, user, group, links, time, length, four numbers of devices, length of the name, check sum.
        numbers = (inode, entry.mode, 0, 0, 1, 0, len(entry.content), 0, 0, 0, 0, len(name), 0)
        for part in (b"070701" + b"".join(b"%08X" % number for number in numbers) + name, entry.content):
            packed += part
            packed += bytes(-len(packed) % _ALIGNMENT)
    return bytes(packed)


def modules_in_order(folder: Path, names: Sequence[str]) -> list[Path]:
    """Return the files of kernel modules and of all that they need, in the order in which they can be loaded.

    The kernel's module folder has the lists that depmod(8) wrote; the names have no endings. One that is built into the
    kernel needs no file.

    Raises:
        ValueError: The kernel has no such module.
    """
    lines = (line.partition(":") for line in (folder / "modules.dep").read_text("utf-8").splitlines())
    needs = {path: needed.split() for path, _, needed in lines}
    built_in = {_stem(path) for path in (folder / "modules.builtin").read_text("utf-8").split()}
    by_name = {_stem(path): path for path in needs}
    ordered: dict[str, None] = {}
    for name in names:
        if name in by_name:
            # depmod lists all that a module needs, what has to be there first last.
            ordered.update(dict.fromkeys([*reversed(needs[by_name[name]]), by_name[name]]))
        elif name not in built_in:
            raise ValueError(f"{folder} has no module {name}")
    return [folder / path for path in ordered]


def _stem(path: str) -> str:
    return path.rpartition("/")[2].partition(".")[0]


def module_content(path: Path) -> bytes:
    """Read a module, unpacked where it is stored compressed, as it is since Debian 13."""
    content = path.read_bytes()
    return lzma.decompress(content) if path.suffix == ".xz" else content


def is_static(program: bytes) -> bool:
    """Whether a 64-bit ELF program runs without any library, as one in an initramfs has to."""
    (offset,) = struct.unpack_from("<Q", program, 32)
    size, count = struct.unpack_from("<HH", program, 54)
    segments = (struct.unpack_from("<I", program, offset + size * index)[0] for index in range(count))
    return _PROGRAM_INTERPRETER not in segments


def available() -> str | None:
    """Check whether this machine can run a guest: None when it can, else what is missing and how to install it."""
    missing = {program: _PACKAGES[program] for program in missing_programs(_PACKAGES)}
    if "busybox" not in missing and not is_static(_busybox()):
        missing["a busybox that needs no libraries"] = _PACKAGES["busybox"]
    if _newest_kernel() is None:
        missing[f"{_KERNELS}/{_KERNEL_NAME} (readable, with its modules)"] = _KERNEL_PACKAGE
    if not missing:
        return None
    packages = " ".join(missing.values())
    return f"not installed: {', '.join(missing)}: sudo apt-get install --no-install-recommends {packages}"


def _busybox() -> bytes:
    return Path(shutil.which("busybox", path=search_path()) or "/bin/busybox").read_bytes()


def _newest_kernel() -> Path | None:
    kernels = [path for path in _KERNELS.glob(_KERNEL_NAME) if os.access(path, os.R_OK)]
    whole = [path for path in kernels if (_modules_of(path) / "modules.dep").is_file()]
    return max(whole, key=lambda path: [int(number) for number in re.findall(r"\d+", path.name)], default=None)


def _modules_of(kernel: Path) -> Path:
    return _MODULES / kernel.name.removeprefix("vmlinuz-")


def run_in_guest(command: Sequence[str], *, bitrate: int = 500_000, **options: Unpack[GuestOptions]) -> GuestResult:
    """Boot a guest with two processors, run one command in it as root, and shut it down.

    Args:
        command: The program and its arguments. This interpreter's folder comes first in the guest's PATH.
        bitrate: Of can0 and can1, bit/s: what the driver is set to, the emulated bus has none.
        **options: How it is run; the memory is 2048 MiB by default.

    Returns:
        The command's exit status and output.

    Raises:
        GuestError: The guest cannot run here, ran out of time, or ended without an exit status.
    """
    missing, kernel = available(), _newest_kernel()
    if missing is not None or kernel is None:
        raise GuestError(f"No guest can run here: {missing}")
    modules = modules_in_order(_modules_of(kernel), _NEEDED_MODULES)
    settings = {"GUEST_MODULES": " ".join(path.name for path in modules), "GUEST_BITRATE": str(bitrate)}
    with prepared_task(command, settings, options) as task:
        first_files = task.scratch / "initramfs"
        first_files.write_bytes(_first_files(task.scratch, modules))
        folders = [*_folder("host", Path("/"), ",readonly=on"), *_folder("scratch", task.scratch)]
        if task.results is not None:
            folders += _folder("results", task.results)
        # tsc=reliable: the emulated counter is the host's clock, so there is nothing to watch or to measure.
        append = "console=ttyS0 quiet loglevel=1 panic=-1 oops=panic mitigations=off tsc=reliable"
        start = ["-kernel", str(kernel), "-initrd", str(first_files), "-append", append]
        words = ["qemu-system-x86_64", *_machine(options.get("memory_mib", 2048)), *folders, *start]
        return run_task(task, words, {"PATH": search_path()})


def _first_files(scratch: Path, modules: Sequence[Path]) -> bytes:
    entries = [
        *(ArchiveEntry(name, FOLDER) for name in ("bin", "dev", "modules", "proc", "run")),
        ArchiveEntry("bin/busybox", PROGRAM, _busybox()),
        ArchiveEntry("bin/sh", SYMBOLIC_LINK, b"busybox"),
        ArchiveEntry("init", PROGRAM, script("qemu_init.sh").encode()),
        *(ArchiveEntry(name, FILE, (scratch / name).read_bytes()) for name in ("guest.sh", "settings.sh")),
        *(ArchiveEntry(f"modules/{path.name}", FILE, module_content(path)) for path in modules),
    ]
    return cpio_archive(entries)


def _machine(memory_mib: int) -> list[str]:
    # No five-level page tables: emulated, each level costs time.
    computer = ["-machine", "pc", "-accel", "tcg,thread=multi", "-cpu", "max,la57=off", "-smp", "2"]
    # -no-reboot: a kernel that panics restarts the machine, which is to end instead.
    only = ["-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-serial", "stdio"]
    card = ["-device", "kvaser_pci,canbus=bus0"]
    return [*computer, "-m", f"{memory_mib}M", *only, "-object", "can-bus,id=bus0", *card, *card]


def _folder(tag: str, path: Path, more: str = "") -> list[str]:
    # multidevs: what is mounted below the folder has file numbers of its own, which may be the same.
    escaped = str(path).replace(",", ",,")
    return ["-virtfs", f"local,path={escaped},mount_tag={tag},security_model=none,multidevs=remap{more}"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the command's exit status, or 125 where the guest itself failed."""
    parser = argparse.ArgumentParser(prog="python -P -m segway_ecc.hil.kernels.qemu")
    parser.add_argument("--bitrate", type=int, default=500_000, help="of can0 and can1, bit/s (default: %(default)s)")
    return command_line(
        parser,
        arguments,
        lambda options, command, common: run_in_guest(command, bitrate=options.bitrate, **common),
    )


if __name__ == "__main__":
    sys.exit(main())

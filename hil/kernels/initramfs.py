# SPDX-License-Identifier: MIT
"""The first file system of a Linux guest: a cpio archive with a shell and the modules that reach the next one."""

import lzma
import stat
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

_ALIGNMENT = 4
_PROGRAM_INTERPRETER = 3
"""PT_INTERP of elf.h: the segment that a program has which needs the host's libraries."""


FOLDER: Final = stat.S_IFDIR | 0o755
PROGRAM: Final = stat.S_IFREG | 0o755
FILE: Final = stat.S_IFREG | 0o644
SYMBOLIC_LINK: Final = stat.S_IFLNK | 0o777
"""What entries are, as in `st_mode`: all can read them, and run programs."""


class ArchiveEntry(NamedTuple):
    """A file of the archive: its path, its type and permissions as in `st_mode`, and its content or link's target."""

    path: str
    mode: int
    content: bytes = b""


def archive(entries: Iterable[ArchiveEntry]) -> bytes:
    """Pack entries as the kernel unpacks them.

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

    Args:
        folder: The kernel's module folder, with the lists that depmod(8) wrote.
        names: File names without endings. One that is built into the kernel needs no file.

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

# SPDX-License-Identifier: MIT
"""File systems and disks made of a folder, without mounting anything."""

import os
import struct
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image.commands import run

MIB: Final = 1 << 20
ROOT_LABEL: Final = "segway-root"
DATA_LABEL: Final = "segway-data"
CONFIG_LABEL: Final = "segway-conf"
_NAMESPACE: Final = uuid.UUID("9c1c4f3e-6d0e-5a53-8f4a-6f2b3c1d7e10")
_SECTOR: Final = 512
_ENTRY: Final = struct.Struct("<B3sB3sII")
"""A partition in a master boot record: status, first sector as cylinder and so on, type, the same of the last, LBA."""
_NO_CHS: Final = b"\xfe\xff\xff"
_LINUX: Final = 0x83
_TABLE_AT: Final = 446
_SPARE: Final = 1.15


def root_file_system(root: Path, image: Path, epoch: int) -> None:
    """Make the root file system of a folder: no journal, since it is never written."""
    used = sum(path.lstat().st_blocks * 512 for path in root.rglob("*"))
    size_mib = round(used * _SPARE / MIB) + 64
    _file_system(image, ROOT_LABEL, size_mib, epoch, ["-O", "^has_journal", "-m", "0", "-d", str(root)])


def data_file_system(image: Path, size_mib: int, epoch: int) -> None:
    """Make an empty data partition; it is filled at the first boot."""
    _file_system(image, DATA_LABEL, size_mib, epoch, ["-m", "1"])


def config_file_system(folder: Path, image: Path, epoch: int) -> None:
    """Make the configuration partition of a folder."""
    _file_system(image, CONFIG_LABEL, 16, epoch, ["-m", "0", "-d", str(folder)])


def disk(image: Path, partitions: Sequence[Path]) -> None:
    """Put partitions onto a disk with a master boot record, each on a whole MiB."""
    table, at = b"", MIB
    with image.open("wb") as file:
        for path in partitions:
            size = -(-path.stat().st_size // MIB) * MIB
            table += _ENTRY.pack(0, _NO_CHS, _LINUX, _NO_CHS, at // _SECTOR, size // _SECTOR)
            at += size
        file.write(bytes(_TABLE_AT) + table.ljust(64, b"\0") + b"\x55\xaa")
        file.truncate(at)
        at = MIB
        for path in partitions:
            _copy_sparse(path, file.fileno(), at)
            at += -(-path.stat().st_size // MIB) * MIB


def copy_sparse(source: Path, target: Path) -> None:
    """Copy a file, leaving out what is empty."""
    with target.open("wb") as file:
        file.truncate(source.stat().st_size)
        _copy_sparse(source, file.fileno(), 0)


def _copy_sparse(source: Path, target: int, at: int) -> None:
    with source.open("rb") as file:
        offset, end = 0, source.stat().st_size
        while offset < end:
            try:
                offset = os.lseek(file.fileno(), offset, os.SEEK_DATA)
            except OSError:  # only holes are left
                return
            chunk = os.pread(file.fileno(), MIB, offset)
            if chunk.count(0) != len(chunk):
                os.pwrite(target, chunk, at + offset)
            offset += len(chunk)


def _file_system(image: Path, label: str, size_mib: int, epoch: int, words: Sequence[str]) -> None:
    image.unlink(missing_ok=True)
    # Names made of the label, so that two builds are the same.
    name = str(uuid.uuid5(_NAMESPACE, label))
    common = ["mke2fs", "-q", "-F", "-t", "ext4", "-L", label, "-U", name, "-E", f"hash_seed={name},lazy_itable_init=0"]
    run([*common, *words, str(image), f"{size_mib}M"], env={"E2FSPROGS_FAKE_TIME": str(epoch)})

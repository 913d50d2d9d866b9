# SPDX-License-Identifier: MIT
"""File systems and disks made of a folder, without mounting anything, and how large the data partition must be."""

import shlex
import struct
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image.recipe import ImageError, run
from segway_ecc.node.recording.log_quota import LogQuota

MIB: Final = 1 << 20
_NAMESPACE: Final = uuid.UUID("9c1c4f3e-6d0e-5a53-8f4a-6f2b3c1d7e10")
_SECTOR: Final = 512
_ENTRY: Final = struct.Struct("<B3sB3sII")
"""A partition in a master boot record: status, first sector as cylinder and so on, type, the same of the last, LBA."""
_NO_CHS: Final = b"\xfe\xff\xff"
_LINUX: Final = 0x83
_TABLE_AT: Final = 446
_SPARE: Final = 1.15
RELEASES: Final = 4
"""`segway-ecc deploy` keeps three of those that were pushed, and puts the next beside them before it removes one."""
_JOURNAL_MIB: Final = 100
"""SystemMaxUse in files/journald.conf."""
_BLOCK: Final = 4096
_PARTITION_SPARE: Final = 1.1
"""For what the file system itself takes, and what it keeps for root."""
_OPTIONS: Final = "RUN_OPTIONS="
_LIMIT: Final = "--log-limit"


def root_file_system(root: Path, image: Path, epoch: int) -> None:
    """Make the root file system of a folder: no journal, since it is never written."""
    used = sum(path.lstat().st_blocks * 512 for path in root.rglob("*"))
    size_mib = round(used * _SPARE / MIB) + 64
    _file_system(image, "segway-root", size_mib, epoch, ["-O", "^has_journal", "-m", "0", "-d", str(root)])


def data_file_system(image: Path, size_mib: int, epoch: int) -> None:
    """Make an empty data partition; it is filled at the first boot."""
    _file_system(image, "segway-data", size_mib, epoch, ["-m", "1"])


def config_file_system(folder: Path, image: Path, epoch: int) -> None:
    """Make the configuration partition of a folder."""
    _file_system(image, "segway-conf", 16, epoch, ["-m", "0", "-d", str(folder)])


def disk(image: Path, partitions: Sequence[Path]) -> None:
    """Put partitions onto a disk with a master boot record, each on a whole MiB."""
    table, at = b"", MIB
    image.unlink(missing_ok=True)
    for path in partitions:
        size = -(-path.stat().st_size // MIB) * MIB
        table += _ENTRY.pack(0, _NO_CHS, _LINUX, _NO_CHS, at // _SECTOR, size // _SECTOR)
        copy_sparse(path, image, at)
        at += size
    with image.open("r+b") as file:
        file.write(bytes(_TABLE_AT) + table.ljust(64, b"\0") + b"\x55\xaa")
        file.truncate(at)


def copy_sparse(source: Path, target: Path, at: int = 0) -> None:
    """Copy a file into one that may be there, from a place in it on, leaving out what is empty."""
    place = ["bs=1M", "conv=sparse", "oflag=seek_bytes", f"seek={at}", "status=none"]
    run(["dd", f"if={source}", f"of={target}", *place])


def _file_system(image: Path, label: str, size_mib: int, epoch: int, words: Sequence[str]) -> None:
    image.unlink(missing_ok=True)
    # Names made of the label, so that two builds are the same.
    name = str(uuid.uuid5(_NAMESPACE, label))
    common = ["mke2fs", "-q", "-F", "-t", "ext4", "-L", label, "-U", name, "-E", f"hash_seed={name},lazy_itable_init=0"]
    run([*common, *words, str(image), f"{size_mib}M"], env={"E2FSPROGS_FAKE_TIME": str(epoch)})


@dataclass(frozen=True, slots=True)
class PartitionContent:
    """What the data partition has to hold, bytes: one release as it is pushed, logs, and what /var begins with."""

    release: int
    logs: int
    system: int

    @property
    def mib(self) -> int:
        """The size of a partition that holds it all, MiB."""
        content = RELEASES * self.release + self.logs + self.system + _JOURNAL_MIB * MIB
        return -(-round(content * _PARTITION_SPARE) // MIB)

    def check(self, size_mib: int) -> None:
        """Refuse a size that is too small.

        Raises:
            ImageError: It is.
        """
        if size_mib < self.mib:
            raise ImageError(
                f"a data partition of {size_mib} MiB is too small: {self.logs / 1e6:.0f} MB of logs and {RELEASES} "
                f"releases of {self.release / 1e6:.0f} MB each take {self.mib} MiB; let --data-size be that, or write "
                f"a smaller {_LIMIT} into RUN_OPTIONS in the configuration's `environment`"
            )


def partition_content(release: Path, wheels: int, system: Path, config: Path | None) -> PartitionContent:
    """What an image's data partition has to hold.

    Args:
        release: The folder of the image's own release; one that is pushed has the same.
        wheels: What the wheels of a release take, bytes: a release that is pushed keeps them.
        system: What /var begins with.
        config: The configuration folder, whose `environment` may limit the logs.

    Raises:
        ImageError: The limit there is no number.
    """
    return PartitionContent(_size(release) + wheels, log_limit(config), _size(system))


def log_limit(config: Path | None) -> int:
    """How much the logs of a robot with this configuration may take, bytes.

    Raises:
        ImageError: The limit in it is no number.
    """
    path = None if config is None else config / "environment"
    if path is None or not path.exists():
        return LogQuota().total_bytes
    lines = [line.strip() for line in path.read_text("utf-8").splitlines()]
    options = [line.removeprefix(_OPTIONS) for line in lines if line.startswith(_OPTIONS)]
    try:
        words = shlex.split(" ".join(shlex.split(options[-1]))) if options else []
        found = [after for word, after in zip(words, [*words[1:], ""], strict=False) if word == _LIMIT]
        found += [word.partition("=")[2] for word in words if word.startswith(f"{_LIMIT}=")]
        return round(float(found[-1]) * 1e6) if found else LogQuota().total_bytes
    except (ValueError, OverflowError):
        raise ImageError(f"{path}: {_LIMIT} in RUN_OPTIONS must be a number of MB") from None


def _size(folder: Path) -> int:
    """What a folder takes on the disk: whole blocks, as `du` counts them elsewhere."""
    sizes = (path.lstat().st_size for path in folder.rglob("*"))
    return sum(-(-size // _BLOCK) * _BLOCK for size in sizes)

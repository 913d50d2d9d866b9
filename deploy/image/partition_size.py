# SPDX-License-Identifier: MIT
"""How large the data partition must be: for logs, for releases that are pushed, and for what the system keeps."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image.commands import ImageError
from segway_ecc.deploy.image.disk import MIB
from segway_ecc.node.recording.log_quota import LogQuota

RELEASES: Final = 4
"""`segway-ecc deploy` keeps three of those that were pushed, and puts the next beside them before it removes one."""
_JOURNAL_MIB: Final = 100
"""SystemMaxUse in files/journald.conf."""
_BLOCK: Final = 4096
_SPARE: Final = 1.1
"""For what the file system itself takes, and what it keeps for root."""
_OPTIONS: Final = "RUN_OPTIONS="
_LIMIT: Final = "--log-limit"


@dataclass(frozen=True, slots=True)
class PartitionContent:
    """What the data partition has to hold, each in bytes.

    Attributes:
        release: One release as it is pushed.
        logs: The logs of runs.
        system: What /var begins with.
    """

    release: int
    logs: int
    system: int

    @property
    def mib(self) -> int:
        """The size of a partition that holds it all, MiB."""
        content = RELEASES * self.release + self.logs + self.system + _JOURNAL_MIB * MIB
        return -(-round(content * _SPARE) // MIB)

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

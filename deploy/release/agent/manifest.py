# SPDX-License-Identifier: MIT
"""What a release consists of, and what became of it: `manifest.json`, written last; what has one is complete."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.deploy.release.agent.files import sha256_of, write_whole

NAME: Final = "manifest.json"
NEW: Final = "new"
HEALTHY: Final = "healthy"
FAILED: Final = "failed"
INTERRUPTED: Final = "interrupted"
_COMPILED: Final = "__pycache__"


@dataclass(frozen=True, slots=True)
class FileDigest:
    """One file: its SHA-256 as hexadecimal digits, and its size in bytes."""

    sha256: str
    size: int

    def mismatch(self, path: Path) -> str:
        """What is wrong with a file that should be this one; empty where it is."""
        try:
            same = path.stat().st_size == self.size and sha256_of(path) == self.sha256
        except OSError:
            return "is missing"
        return "" if same else "was changed"


@dataclass(frozen=True, slots=True)
class ReleaseManifest:
    """A release.

    Attributes:
        name: Of its folder.
        version: What its `segway-ecc --version` prints.
        created: When it was completed, ISO 8601, UTC.
        by: Who pushed it.
        files: Every file of it by its path, but for compiled Python.
        rate_hz: The rate of its robot's loop, where known.
        state: `new`, `healthy`, `failed`, or `interrupted` in its trial.
        reason: Why it failed.
    """

    name: str
    version: str = ""
    created: str = ""
    by: str = ""
    files: Mapping[str, FileDigest] = dataclasses.field(default_factory=dict)
    rate_hz: float | None = None
    state: str = NEW
    reason: str = ""

    def write(self, folder: Path) -> None:
        """Put it into the release's folder."""
        write_whole(folder / NAME, json.dumps(dataclasses.asdict(self), indent=1).encode())


def read_manifest(folder: Path) -> ReleaseManifest | None:
    """The manifest of a release; None where there is none that can be read, so that the release is not complete."""
    try:
        found = json.loads((folder / NAME).read_bytes())
        files = {
            str(path): FileDigest(str(at["sha256"]), int(at["size"])) for path, at in found.get("files", {}).items()
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None
    texts = {key: str(found[key]) for key in ("version", "created", "by", "state", "reason") if key in found}
    rate = found.get("rate_hz")
    return ReleaseManifest(
        name=folder.name, files=files, rate_hz=float(rate) if isinstance(rate, int | float) else None, **texts
    )


def entries_of(folder: Path) -> dict[str, FileDigest]:
    """Every file below a folder; no links, nothing compiled, not the manifest itself."""
    return {
        path.relative_to(folder).as_posix(): FileDigest(sha256_of(path), path.stat().st_size)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.is_symlink() and _COMPILED not in path.parts and path != folder / NAME
    }


def differences(folder: Path, files: Mapping[str, FileDigest]) -> list[str]:
    """The files that are not as in the manifest, with what is wrong; none for a release that is whole."""
    return [f"{path} {wrong}" for path, digest in files.items() if (wrong := digest.mismatch(folder / path))]

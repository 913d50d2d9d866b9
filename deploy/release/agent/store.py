# SPDX-License-Identifier: MIT
"""The releases on a robot: what each consists of, and which of them is in use, with its robot file.

A release's `manifest.json` is written last: what has one is complete.
"""

import contextlib
import dataclasses
import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from segway_ecc.deploy.release.agent.files import AgentRefusedError, link_whole, sha256_of, sync_folder, write_whole

MANIFEST: Final = "manifest.json"
NEW: Final = "new"
HEALTHY: Final = "healthy"
FAILED: Final = "failed"
INTERRUPTED: Final = "interrupted"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+_-]{0,99}")
_INCOMING: Final = ".incoming-"
_TRASH: Final = ".trash-"
ROBOT_FILE: Final = "robot/robot.yaml"
"""In a release."""
_BACKUP: Final = "robot.yaml.before-deploy"


@dataclass(frozen=True, slots=True)
class FileDigest:
    """One file: its SHA-256 as hexadecimal digits, and its size in bytes."""

    sha256: str
    size: int

    @classmethod
    def of(cls, path: Path) -> "FileDigest":
        """That of a file as it is."""
        return cls(sha256_of(path), path.stat().st_size)

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
        write_whole(folder / MANIFEST, json.dumps(dataclasses.asdict(self), indent=1).encode())


def digests_from(found: Mapping[str, Any]) -> dict[str, FileDigest]:
    """Files by their paths, from JSON."""
    return {str(path): FileDigest(str(at["sha256"]), int(at["size"])) for path, at in found.items()}


def read_manifest(folder: Path) -> ReleaseManifest | None:
    """The manifest of a release; None where there is none that can be read, so that the release is not complete."""
    try:
        found = json.loads((folder / MANIFEST).read_bytes())
        files = digests_from(found.get("files", {}))
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
        path.relative_to(folder).as_posix(): FileDigest.of(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.is_symlink() and "__pycache__" not in path.parts and path != folder / MANIFEST
    }


def differences(folder: Path, files: Mapping[str, FileDigest]) -> list[str]:
    """The files that are not as in the manifest, with what is wrong; none for a release that is whole."""
    return [f"{path} {wrong}" for path, digest in files.items() if (wrong := digest.mismatch(folder / path))]


class Store:
    """The folder `root`: `releases/<name>/`, and the link `current` to one of them."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.releases = root / "releases"

    def folder(self, name: str) -> Path:
        """Where a release lies, or would.

        Raises:
            AgentRefusedError: The name is not valid.
        """
        if not _NAME.fullmatch(name):
            raise AgentRefusedError(f"{name!r} is no name of a release")
        return self.releases / name

    def incoming(self, name: str) -> Path:
        """Where a release is received."""
        return self.folder(name).with_name(f"{_INCOMING}{name}")

    def current(self) -> str | None:
        """The release in use."""
        try:
            target = (self.root / "current").readlink()
        except OSError:
            return None
        is_ours = (self.root / target).parent == self.releases and _NAME.fullmatch(target.name)
        return target.name if is_ours else None

    def switch(self, name: str) -> None:
        """Have `current` lead to a release: before or after, never neither."""
        self.folder(name)
        link_whole(self.root / "current", f"releases/{name}")

    def manifest(self, name: str) -> ReleaseManifest | None:
        """The manifest of a release; None where it is not complete."""
        return read_manifest(self.folder(name))

    def complete(self) -> list[ReleaseManifest]:
        """All complete releases, the oldest first."""
        found = self._manifests().values()
        return sorted((m for m in found if m is not None), key=lambda m: (m.created, m.name))

    def incomplete(self) -> list[str]:
        """Folders that an interrupted update left."""
        return sorted(name for name, manifest in self._manifests().items() if manifest is None)

    def before(self, name: str | None) -> str | None:
        """The newest healthy release that is older than a given one; what a rollback goes to."""
        older = self.complete()
        names = [manifest.name for manifest in older]
        if name in names:
            older = older[: names.index(name)]
        return next((m.name for m in reversed(older) if m.state == HEALTHY), None)

    def way_back(self, name: str) -> str | None:
        """What an update to a release goes back to: what is in use, unless it failed; else the newest healthy one."""
        current = self.current()
        others = [manifest for manifest in self.complete() if manifest.name != name]
        if any(manifest.name == current and manifest.state != FAILED for manifest in others):
            return current
        return next((m.name for m in reversed(others) if m.state == HEALTHY), None)

    def verify(self, name: str) -> None:
        """Compare a release with its manifest.

        Raises:
            AgentRefusedError: It is not there, not complete, or was changed.
        """
        manifest = self.manifest(name)
        if manifest is None:
            known = ", ".join(m.name for m in self.complete()) or "none"
            raise AgentRefusedError(f"there is no complete release {name!r}; there is {known}")
        wrong = differences(self.folder(name), manifest.files)
        if wrong:
            raise AgentRefusedError(f"release {name} is not as it was pushed: {'; '.join(wrong[:3])}; push it again")

    def tidy(self, keep: set[str]) -> None:
        """Remove what interrupted updates left, but for the folders named."""
        for name in self.incomplete():
            if name not in keep and name != self.current():
                self.remove(name)

    def prune(self, newest: int, keep: set[str]) -> list[str]:
        """Remove old releases: all but the newest, the one in use, the one a rollback goes to, and those named."""
        current = self.current()
        names = [manifest.name for manifest in self.complete()]
        held = {current, self.before(current), *keep, *names[-newest:]}
        gone = [name for name in names if name not in held]
        for name in gone:
            self.remove(name)
        return gone

    def remove(self, name: str) -> None:
        """Remove a folder; renamed first, so that half of it is never taken for a release."""
        folder = self.releases / name
        if not name.startswith(_TRASH):
            trash = folder.with_name(f"{_TRASH}{name.lstrip('.')}")
            shutil.rmtree(trash, ignore_errors=True)
            folder = folder.rename(trash)
            sync_folder(self.releases)
        shutil.rmtree(folder, ignore_errors=True)

    def _manifests(self) -> dict[str, ReleaseManifest | None]:
        """The manifest of each folder by its name; None for one that is not complete, or is no release."""
        folders: list[Path] = []
        with contextlib.suppress(OSError):
            folders += [folder for folder in self.releases.iterdir() if folder.is_dir() and not folder.is_symlink()]
        return {folder.name: read_manifest(folder) if _NAME.fullmatch(folder.name) else None for folder in folders}


def is_robot_file_linked(store: Store, config: Path) -> bool:
    """Whether the robot file in use comes with the release."""
    link = config / "robot.yaml"
    return link.is_symlink() and str(link.readlink()) == str(store.root / "current" / ROBOT_FILE)


def link_robot_file(store: Store, config: Path, name: str) -> None:
    """Link the configuration to the releases' robot files, if this release brings one.

    What was there is kept beside it, and releases that have none lead to it, so that a rollback finds it; for those in
    use nothing changes.
    """
    machine, backup = config / "robot.yaml", config / _BACKUP
    is_linked = is_robot_file_linked(store, config)
    if not is_linked:
        if not (store.folder(name) / ROBOT_FILE).exists():
            return
        config.mkdir(parents=True, exist_ok=True)
        if machine.exists():
            shutil.copyfile(machine, backup)
    for manifest in store.complete() if backup.exists() else ():
        place = store.folder(manifest.name) / ROBOT_FILE
        if not place.exists():
            place.parent.mkdir(exist_ok=True)
            link_whole(place, str(backup))  # a link, so that the models that stand beside the machine's are found
    if not is_linked:
        link_whole(machine, str(store.root / "current" / ROBOT_FILE))

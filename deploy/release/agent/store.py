# SPDX-License-Identifier: MIT
"""The releases on a robot, and which of them is in use."""

import contextlib
import re
import shutil
from pathlib import Path
from typing import Final

from segway_ecc.deploy.release.agent.files import AgentRefusedError, link_whole, sync_folder
from segway_ecc.deploy.release.agent.manifest import FAILED, HEALTHY, ReleaseManifest, differences, read_manifest

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+_-]{0,99}")
_INCOMING: Final = ".incoming-"
_TRASH: Final = ".trash-"


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

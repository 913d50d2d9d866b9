# SPDX-License-Identifier: MIT
"""The robot file becomes part of the release: `robot.yaml` of the configuration leads to that of the release in use."""

import shutil
from pathlib import Path
from typing import Final

from segway_ecc.deploy.release.agent.files import link_whole
from segway_ecc.deploy.release.agent.install import ROBOT_FILE
from segway_ecc.deploy.release.agent.store import Store

BACKUP: Final = "robot.yaml.before-deploy"


def is_robot_file_linked(store: Store, config: Path) -> bool:
    """Whether the robot file in use comes with the release."""
    link = config / "robot.yaml"
    return link.is_symlink() and str(link.readlink()) == str(store.root / "current" / ROBOT_FILE)


def link_robot_file(store: Store, config: Path, name: str) -> None:
    """Link the configuration to the releases' robot files, if this release brings one.

    What was there is kept beside it, and releases that have none lead to it, so that a rollback finds it; for those in
    use nothing changes.
    """
    machine, backup = config / "robot.yaml", config / BACKUP
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

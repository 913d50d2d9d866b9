# SPDX-License-Identifier: MIT
"""What is on the robot: looked at only, nothing is changed."""

import dataclasses
import importlib.util
import os
import platform
import struct
import sys
import sysconfig
from pathlib import Path
from typing import Any

from segway_ecc.deploy.release.agent.files import AgentRefusedError, is_locked
from segway_ecc.deploy.release.agent.journal import Journal
from segway_ecc.deploy.release.agent.robot_link import is_robot_file_linked
from segway_ecc.deploy.release.agent.services import show
from segway_ecc.deploy.release.agent.store import Store


def probe(store: Store, config: Path) -> dict[str, Any]:
    """The machine, for whoever collects wheels for it."""
    current = store.current()
    manifest = store.manifest(current) if current is not None else None
    robot = {
        path: dataclasses.asdict(entry)
        for path, entry in (manifest.files.items() if manifest else ())
        if path.startswith("robot/") and is_robot_file_linked(store, config)
    }
    return {
        "python": list(sys.version_info[:2]),
        "machine": platform.machine(),
        "pointer_bits": struct.calcsize("P") * 8,
        "libc": list(platform.libc_ver()),
        "soabi": sysconfig.get_config_var("SOABI") or "",
        "system_ros": any(Path("/opt/ros").glob("*/setup.sh")) or importlib.util.find_spec("rclpy") is not None,
        "robot_files": robot,
        "has_robot_file": (config / "robot.yaml").exists(),
    }


def status(store: Store, *, verify: bool) -> dict[str, Any]:
    """The releases, the one in use, the last update and the node."""
    current, journal = store.current(), Journal(store.root)
    pending, last = journal.pending(), journal.last()
    releases = []
    for manifest in store.complete():
        values = dataclasses.asdict(dataclasses.replace(manifest, files={})) | {"is_current": manifest.name == current}
        del values["files"]
        if verify:
            try:
                store.verify(manifest.name)
                values["changed"] = ""
            except AgentRefusedError as error:
                values["changed"] = str(error)
        releases.append(values)
    try:
        node = dataclasses.asdict(show())
    except AgentRefusedError as error:
        node = {"active": "unknown", "reason": str(error)}
    try:
        disk = os.statvfs(store.root)
        free_mb = round(disk.f_bavail * disk.f_frsize / 1e6, 1)
    except OSError:
        free_mb = None
    return {
        "current": current,
        "rollback_to": store.before(current),
        "releases": releases,
        "incomplete": store.incomplete(),
        "is_updating": is_locked(store.root),
        "pending": dataclasses.asdict(pending) if pending else None,
        "last": dataclasses.asdict(last) if last else None,
        "free_mb": free_mb,
        "node": node,
    }

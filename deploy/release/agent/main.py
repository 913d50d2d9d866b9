# SPDX-License-Identifier: MIT
"""The robot's side of `segway-ecc deploy`, and what settles an interrupted update at boot."""

import dataclasses
import importlib.util
import json
import os
import platform
import struct
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

from segway_ecc.deploy.release.agent.files import AgentRefusedError, is_locked, locked, write_whole
from segway_ecc.deploy.release.agent.install import (
    ReleaseSpec,
    check_free_space,
    install,
    receive,
    release_spec_from,
    self_test,
)
from segway_ecc.deploy.release.agent.journal import Journal, Reporter, Transaction, stamp
from segway_ecc.deploy.release.agent.services import NODE, show
from segway_ecc.deploy.release.agent.store import (
    FAILED,
    HEALTHY,
    ReleaseManifest,
    Store,
    is_robot_file_linked,
    link_robot_file,
)
from segway_ecc.deploy.release.agent.update import Rules, Update, detached, recover

REFUSED: Final = 11
AGENT: Final = "agent.pyz"


def serve(agent: bytes, stream: BinaryIO, reporter: Reporter) -> int:
    """Answer one request, a line of JSON on `stream` with its files after it; returns the exit code.

    `agent` is this program, kept on the robot for the next boot; `reporter` takes the answer.
    """
    os.umask(0o022)  # the node runs as another user, who must be able to read its release
    request = json.loads(stream.readline())
    store, config = Store(Path(request["root"])), Path(request["config"])
    try:
        match request["verb"]:
            case "probe":
                reporter.event("end", **probe(store, config))
                return 0
            case "status":
                reporter.event("end", **status(store, verify=bool(request["verify"])))
                return 0
        store.releases.mkdir(parents=True, exist_ok=True)
        with locked(store.root):
            write_whole(store.root / AGENT, agent)
            return _change_release(store, request, reporter, stream)
    except AgentRefusedError as error:
        reporter.event("refused", text=str(error))
    except PermissionError as error:
        reporter.event("refused", text=f"{error.filename}: no permission; log in as root, or give --sudo")
    except OSError as error:
        reporter.event("refused", text=str(error))
    return REFUSED


def main(arguments: Sequence[str]) -> int:
    """`settle [ROOT]`: before the services start, go back from an update that the power cut interrupted."""
    if arguments[:1] != ["settle"]:
        sys.stderr.write("usage: agent.pyz settle [ROOT]\n")
        return 2
    store = Store(Path(arguments[1] if len(arguments) > 1 else "/opt/segway-ecc"))
    reporter = Reporter(sys.stdout.buffer)
    try:
        with locked(store.root):
            settled = recover(store, reporter, restarts=False)
    except (AgentRefusedError, OSError) as error:
        sys.stderr.write(f"settle: {error}\n")
        return REFUSED
    if settled is not None:
        reporter.event("settled", release=settled.release, outcome=settled.outcome, current=store.current())
    return 0


def _change_release(store: Store, request: Mapping[str, Any], reporter: Reporter, stream: BinaryIO) -> int:
    rules, kind = Rules(**request["rules"]), request["verb"]
    reporter.step("check")
    node = show()
    if node.load != "loaded":
        raise AgentRefusedError(f"{NODE} is not installed there ({node.load}): see the first steps in docs/deploy.md")
    if (why_not := node.why_not_safe()) is not None:
        raise AgentRefusedError(why_not)
    recover(store, reporter, rules.restart, restarts=True)
    if kind == "rollback":
        name, by = _prepare_rollback(store, request, reporter), str(request["by"])
    else:
        spec = release_spec_from(request["release"])
        name, by = spec.name, spec.by
        if not _prepare_push(store, spec, request, reporter, stream):
            store.tidy(set())
            store.prune(rules.keep, set())
            reporter.event("end", outcome="already", reason="", release=name, current=name)
            return 0
    # Switch only while somebody is there: a connection that was cut, even silently, never sends `go`.
    reporter.event("ready")
    if stream.readline() != b"go\n":
        raise AgentRefusedError("the connection ended before the switch: nothing was switched")
    transaction = Transaction(kind, name, store.way_back(name), by, stamp())
    return detached(reporter, lambda: Update(store, rules, reporter).run(transaction))


def _prepare_push(
    store: Store, spec: ReleaseSpec, request: Mapping[str, Any], reporter: Reporter, stream: BinaryIO
) -> bool:
    """Have a release complete and tested; False where it is in use and healthy already."""
    found = store.manifest(spec.name)
    if found is not None and found.state == FAILED and not request["again"]:
        raise AgentRefusedError(f"{found.name} failed before: {found.reason}; fix it, or push with --again")
    is_current = store.current() == spec.name
    try:
        store.verify(spec.name)
    except AgentRefusedError:
        if is_current:
            raise AgentRefusedError(
                f"{spec.name} is in use and was changed by hand: roll back first, then push it again"
            ) from None
        store.tidy({spec.name, store.incoming(spec.name).name})
        check_free_space(store, spec)
        reporter.step("receive")
        receive(store, spec, stream, reporter)
        install(store, spec, reporter)
        found = store.manifest(spec.name)
    if found is None:
        raise AgentRefusedError(f"{spec.name} was not completed")
    if is_current and found.state == HEALTHY:
        return False
    config = Path(request["config"])
    self_test(store, found, config, reporter)
    link_robot_file(store, config, spec.name)
    return True


def _prepare_rollback(store: Store, request: Mapping[str, Any], reporter: Reporter) -> str:
    """Have the release tested that is gone back to; its name."""
    config, name = Path(request["config"]), request["to"] or store.before(store.current())
    if name is None:
        raise AgentRefusedError("there is no older healthy release to go back to; name one with --to")
    if name == store.current():
        raise AgentRefusedError(f"{name} is in use already")
    store.verify(name)
    self_test(store, store.manifest(name) or ReleaseManifest(name), config, reporter)
    if is_robot_file_linked(store, config):
        link_robot_file(store, config, name)
    return str(name)


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

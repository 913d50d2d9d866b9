"""The robot's side of `segway-ecc deploy`, and what settles an interrupted update at boot."""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

from segway_ecc.deploy.release.agent.files import AgentRefusedError, locked, write_whole
from segway_ecc.deploy.release.agent.install import (
    check_room,
    install,
    is_healthy,
    receive,
    refuse_failed,
    release_spec_from,
    robot_of,
    self_test,
)
from segway_ecc.deploy.release.agent.journal import Transaction, stamp
from segway_ecc.deploy.release.agent.manifest import FAILED, ReleaseManifest
from segway_ecc.deploy.release.agent.report import Reporter
from segway_ecc.deploy.release.agent.robot_link import is_robot_file_linked, link_robot_file
from segway_ecc.deploy.release.agent.services import NODE, show
from segway_ecc.deploy.release.agent.status import probe, status
from segway_ecc.deploy.release.agent.store import Store
from segway_ecc.deploy.release.agent.update import Rules, Update, detached, recover

REFUSED: Final = 11
AGENT: Final = "agent.pyz"


def serve(agent: bytes, stream: BinaryIO, reporter: Reporter) -> int:
    """Answer one request, a line of JSON on `stream`.

    Args:
        agent: This program, kept on the robot for the next boot.
        stream: The request, and after it the files.
        reporter: Takes the answer.

    Returns:
        The exit code.
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
        _prepare(store)
        with locked(store.root):
            write_whole(store.root / AGENT, agent)
            rules = Rules(**request["rules"])
            reporter.step("check")
            if request["verb"] == "rollback":
                return _rollback(store, request, rules, reporter, stream)
            return _push(store, request, rules, reporter, stream)
    except AgentRefusedError as error:
        reporter.event("refused", text=str(error))
    except PermissionError as error:
        reporter.event("refused", text=f"{error.filename}: no permission; log in as root, or give --sudo")
    except OSError as error:
        reporter.event("refused", text=str(error))
    return REFUSED


def main(arguments: Sequence[str]) -> int:
    """`settle [ROOT]`: before the services start, leave an update that the power cut interrupted."""
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


def _prepare(store: Store) -> None:
    store.releases.mkdir(parents=True, exist_ok=True)


def _push(store: Store, request: Mapping[str, Any], rules: Rules, reporter: Reporter, stream: BinaryIO) -> int:
    wanted, config = release_spec_from(request["release"]), Path(request["config"])
    _refuse_unsafe()
    recover(store, reporter, rules.restart, restarts=True)
    found = store.manifest(wanted.name)
    refuse_failed(found, again=bool(request["again"]))
    whole = _is_whole(store, wanted.name)
    if whole and is_healthy(found) and store.current() == wanted.name:
        store.tidy(set())
        store.prune(rules.keep, set())
        reporter.event("end", outcome="already", reason="", release=wanted.name, current=wanted.name)
        return 0
    if not whole:
        if store.current() == wanted.name:
            raise AgentRefusedError(
                f"{wanted.name} is in use and was changed by hand: roll back first, then push it again"
            )
        store.tidy({wanted.name, store.incoming(wanted.name).name})
        check_room(store, wanted)
        reporter.step("receive")
        receive(store, wanted, stream, reporter)
        install(store, wanted, reporter)
        found = store.manifest(wanted.name)
    if found is None:
        raise AgentRefusedError(f"{wanted.name} was not completed")
    reporter.step("selftest")
    self_test(store, found, robot_of(store, wanted.name, config))
    link_robot_file(store, config, wanted.name)
    _await_go(stream, reporter)
    transaction = Transaction("push", wanted.name, _way_back(store, wanted.name), wanted.by, stamp())
    return detached(reporter, lambda: Update(store, rules, reporter).run(transaction))


def _rollback(store: Store, request: Mapping[str, Any], rules: Rules, reporter: Reporter, stream: BinaryIO) -> int:
    config, target = Path(request["config"]), request["to"]
    _refuse_unsafe()
    recover(store, reporter, rules.restart, restarts=True)
    target = target or store.before(store.current())
    if target is None:
        raise AgentRefusedError("there is no older healthy release to go back to; name one with --to")
    if target == store.current():
        raise AgentRefusedError(f"{target} is in use already")
    store.verify(target)
    reporter.step("selftest")
    manifest = store.manifest(target) or ReleaseManifest(target)
    self_test(store, manifest, robot_of(store, target, config))
    if is_robot_file_linked(store, config):
        link_robot_file(store, config, target)
    _await_go(stream, reporter)
    transaction = Transaction("rollback", target, _way_back(store, target), str(request["by"]), stamp())
    return detached(reporter, lambda: Update(store, rules, reporter).run(transaction))


def _way_back(store: Store, name: str) -> str | None:
    """What is in use, unless it failed; else the newest healthy release."""
    current = store.current()
    manifest = store.manifest(current) if current is not None else None
    if manifest is not None and manifest.state != FAILED and current != name:
        return current
    return next((m.name for m in reversed(store.complete()) if is_healthy(m) and m.name != name), None)


def _await_go(stream: BinaryIO, reporter: Reporter) -> None:
    """Switch only while somebody is there: a connection that was cut, even silently, never says go."""
    reporter.event("ready")
    if stream.readline() != b"go\n":
        raise AgentRefusedError("the connection ended before the switch: nothing was switched")


def _is_whole(store: Store, name: str) -> bool:
    try:
        store.verify(name)
    except AgentRefusedError:
        return False
    return True


def _refuse_unsafe() -> None:
    node = show()
    if node.load != "loaded":
        raise AgentRefusedError(f"{NODE} is not installed there ({node.load}): see the first steps in docs/deploy.md")
    if (why_not := node.why_not_safe()) is not None:
        raise AgentRefusedError(why_not)

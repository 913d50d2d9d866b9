# SPDX-License-Identifier: MIT
"""Push, rollback and status: what the verbs request of a robot.

What is pushed is our wheel, the wheels of all it needs on that robot, pip itself, and the robot file.
"""

import getpass
import hashlib
import json
import platform
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

from segway_ecc.deploy.release.agent.files import is_safe
from segway_ecc.deploy.release.agent.install import ReleaseSpec
from segway_ecc.deploy.release.agent.store import ROBOT_FILE, FileDigest
from segway_ecc.deploy.release.agent.update import Rules
from segway_ecc.deploy.release.host import Event, Host
from segway_ecc.deploy.release.wheels import WHEEL, build_wheel, collect, extras_text, target_from, version_of
from segway_ecc.node.config import RobotFile, decode_robot
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.load import PythonSource

Ros = Literal["auto", "system", "pypi", "none"]
_DIGITS: Final = 8


@dataclass(frozen=True, slots=True)
class Content:
    """What is pushed.

    Attributes:
        wheel: Our wheel; None to build it from this checkout.
        robot: The robot file and what stands beside it, by path in the release.
        extras: Extras of our wheel.
        ros: Where the robot's ROS 2 comes from.
        refresh: Whether the index is asked even where the cache has all wheels.
        again: Whether it is tried even if it failed on that robot before.
    """

    wheel: Path | None = None
    robot: Mapping[str, Path] | None = None
    extras: Sequence[str] = ()
    ros: Ros = "auto"
    refresh: bool = False
    again: bool = False


def push(host: Host, rules: Rules, content: Content, on_event: Callable[[Event], None]) -> Event:
    """Put a version onto a robot and have it tried there; returns the last event, with the outcome."""
    if content.wheel is not None:
        version_of(content.wheel)
    target = target_from(host.ask({"verb": "probe"}, on_event))
    if not (content.robot or target.has_robot_file):
        raise ConfigurationError(f"{host.address} has no robot file yet: give one with --robot FILE")
    extras, ros = set(content.extras), content.ros
    if ros == "auto":
        ros = "system" if target.system_ros else "pypi" if target.machine == "x86_64" else "none"
    if ros == "pypi":
        extras.add("ros")
    with tempfile.TemporaryDirectory(prefix="segway-ecc-push-") as name:
        folder = Path(name)
        on_event({"event": "step", "step": "build"})
        wheel = content.wheel or build_wheel(folder)
        on_event({"event": "step", "step": "collect"})
        (folder / "wheels").mkdir()
        wheels = collect(wheel, extras, target, folder / "wheels", refresh=content.refresh)
        held = {} if content.robot else target.robot_files
        spec, files = bundle(wheels, content.robot or {}, extras, system_site=ros == "system", held=held)
        request = {"verb": "push", "rules": asdict(rules), "again": content.again, "release": asdict(spec)}
        return host.ask(request, on_event, files)


def rollback(host: Host, rules: Rules, to: str | None, on_event: Callable[[Event], None]) -> Event:
    """Take the robot back to an older release: `to`, or the newest healthy one."""
    return host.ask({"verb": "rollback", "rules": asdict(rules), "to": to, "by": whoami()}, on_event)


def status(host: Host, *, verify: bool) -> Event:
    """What is on the robot."""
    return host.ask({"verb": "status", "verify": verify}, lambda _: None)


def bundle(
    wheels: Sequence[Path],
    robot: Mapping[str, Path],
    extras: Collection[str] = (),
    *,
    system_site: bool = False,
    held: Mapping[str, FileDigest] | None = None,
) -> tuple[ReleaseSpec, Mapping[str, Path]]:
    """Put a release together; its name has a digest of all content, so that other content never has the same name.

    Args:
        wheels: All that pip collected, ours and pip's among them.
        robot: The robot file and what stands beside it, by path.
        extras: Extras of our wheel that are installed too.
        system_site: Whether the release sees the robot's own Python packages.
        held: Files that the robot has already and that belong to the release too.

    Returns:
        The release, and where each file of it lies here, by its path in the release.
    """
    places = {f"wheels/{path.name}": path for path in sorted(wheels)} | dict(robot)
    files = {path: FileDigest.of(place) for path, place in places.items()} | dict(held or {})
    wheel = next(path for path in wheels if path.match(WHEEL))
    requirement = f"wheels/{wheel.name}{extras_text(extras)}"
    entries = {path: asdict(digest) for path, digest in files.items()}
    content = json.dumps([requirement, system_site, entries], sort_keys=True)
    version = version_of(wheel)
    name = f"{version}-{hashlib.sha256(content.encode()).hexdigest()[:_DIGITS]}"
    return ReleaseSpec(name, version, whoami(), requirement, system_site, files), places


def whoami() -> str:
    """Who is at work here, for the manifest."""
    return f"{getpass.getuser()}@{platform.node()}"


def robot_files(path: Path, file: RobotFile) -> dict[str, Path]:
    """A robot file and the models that stand beside it, by their paths in the release.

    Raises:
        ConfigurationError: One has a name that the robot does not accept, or lies elsewhere, from where none travels.
    """
    found = {ROBOT_FILE: path}
    folder = path.resolve().parent
    written = decode_robot(path.read_text(encoding="utf-8"), str(path))
    for source, as_written in zip(_sources(file), _sources(written), strict=True):
        if as_written.startswith("/"):
            raise ConfigurationError(f"{path}: {as_written} is not there on the robot: write it from the file's folder")
        for place in _files(folder, source):
            found[f"robot/{place.relative_to(folder).as_posix()}"] = place
    for name in found:
        if not is_safe(name):
            raise ConfigurationError(f"{name}: rename it; letters, digits and _.+- only, and no hidden files")
    return found


def _sources(file: RobotFile) -> list[str]:
    return [file.model.source, *([file.simulation.plant] if file.simulation is not None else [])]


def _files(folder: Path, source: str) -> Iterator[Path]:
    """The files of a model that lies in a folder; none for one that is installed."""
    python = PythonSource.parse(source)
    if python is None:
        place = folder / source
        place = place if place.exists() else Path(source).resolve()
    elif python.folder is None:
        return
    else:
        place = python.folder / python.top
        place = place if place.is_dir() else place.with_name(f"{python.top}.py")
    if not source or folder not in place.resolve().parents:
        raise ConfigurationError(
            f"{place} does not lie beside the robot file and cannot be sent along: move it into {folder}"
        )
    if place.is_dir():
        yield from (at for at in sorted(place.rglob("*")) if at.is_file() and "__pycache__" not in at.parts)
    elif place.is_file():
        yield place

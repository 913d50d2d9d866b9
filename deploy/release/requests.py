"""Push, rollback and status: what the verbs ask of a robot."""

import getpass
import platform
import shlex
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from segway_ecc.deploy.release.bundle import Installing, bundle, version_of
from segway_ecc.deploy.release.host import Event, Host
from segway_ecc.deploy.release.target import Target, target_from
from segway_ecc.deploy.release.wheels import build_wheel, collect
from segway_ecc.node.errors import ConfigurationError

Ros = Literal["auto", "system", "pypi", "none"]


@dataclass(frozen=True, slots=True)
class RemotePaths:
    """Where everything lies on the robot.

    Attributes:
        root: Of the releases.
        config: Of the robot file.
    """

    root: str = "/opt/segway-ecc"
    config: str = "/etc/segway-ecc"


@dataclass(frozen=True, slots=True)
class Trying:
    """How an update is tried.

    Attributes:
        trial_s: How long the node must be healthy on end, s.
        start_s: How long it may take until it is, s.
        keep: How many of the newest releases stay.
        restart: A command that restarts the services instead of ours.
    """

    trial_s: float = 10.0
    start_s: float = 30.0
    keep: int = 3
    restart: str = ""

    def as_request(self) -> dict[str, Any]:
        """As the robot's side takes it; the command as words, since no shell will see it."""
        try:
            words = shlex.split(self.restart)
        except ValueError as error:
            raise ConfigurationError(f"--restart: {error}") from None
        return {"trial_s": self.trial_s, "start_s": self.start_s, "keep": self.keep, "restart": words}


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


def push(host: Host, place: RemotePaths, trying: Trying, content: Content, on_event: Callable[[Event], None]) -> Event:
    """Put a version onto a robot and have it tried there; the last event tells how it ended."""
    request = _request("push", place) | {"rules": trying.as_request(), "again": content.again}
    if content.wheel is not None:
        version_of(content.wheel)
    target = target_from(host.ask(_request("probe", place), on_event))
    if not (content.robot or target.has_robot_file):
        raise ConfigurationError(f"{host.address} has no robot file yet: give one with --robot FILE")
    with tempfile.TemporaryDirectory(prefix="segway-ecc-push-") as name:
        folder = Path(name)
        on_event({"event": "step", "step": "build"})
        wheel = content.wheel or build_wheel(folder)
        on_event({"event": "step", "step": "collect"})
        extras, system_site = _with_ros(content, target)
        wheels = collect(wheel, extras, target, _new(folder / "wheels"), refresh=content.refresh)
        how = Installing(tuple(extras), system_site=system_site)
        made = bundle(wheel, wheels, content.robot or {}, how, held={} if content.robot else target.robot_files)
        return host.ask(request | {"release": made.as_request(whoami())}, on_event, made.files)


def rollback(
    host: Host, place: RemotePaths, trying: Trying, to: str | None, on_event: Callable[[Event], None]
) -> Event:
    """Take the robot back to an older release, the newest healthy one unless told otherwise."""
    request = _request("rollback", place) | {"rules": trying.as_request(), "to": to, "by": whoami()}
    return host.ask(request, on_event)


def status(host: Host, place: RemotePaths, *, verify: bool) -> Event:
    """What is on the robot."""
    return host.ask(_request("status", place) | {"verify": verify}, lambda _: None)


def whoami() -> str:
    """Who is at work here, for the manifest."""
    return f"{getpass.getuser()}@{platform.node()}"


def _request(verb: str, place: RemotePaths) -> dict[str, Any]:
    return {"verb": verb, "root": place.root, "config": place.config}


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _with_ros(content: Content, target: Target) -> tuple[list[str], bool]:
    """The extras, and whether the system's packages are seen, for the ROS that is wanted."""
    extras, ros = set(content.extras), content.ros
    if ros == "auto":
        ros = "system" if target.system_ros else "pypi" if target.machine == "x86_64" else "none"
    return sorted(extras | ({"ros"} if ros == "pypi" else set())), ros == "system"

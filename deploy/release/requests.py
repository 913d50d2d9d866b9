# SPDX-License-Identifier: MIT
"""Push, rollback and status: what the verbs request of a robot."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from segway_ecc.deploy.release.agent.update import Rules
from segway_ecc.deploy.release.bundle import bundle, whoami
from segway_ecc.deploy.release.host import Event, Host
from segway_ecc.deploy.release.wheels import build_wheel, collect, target_from, version_of
from segway_ecc.node.errors import ConfigurationError

Ros = Literal["auto", "system", "pypi", "none"]


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
        wheels = collect(wheel, sorted(extras), target, folder / "wheels", refresh=content.refresh)
        held = {} if content.robot else target.robot_files
        spec, files = bundle(wheels, content.robot or {}, sorted(extras), system_site=ros == "system", held=held)
        request = {"verb": "push", "rules": asdict(rules), "again": content.again, "release": asdict(spec)}
        return host.ask(request, on_event, files)


def rollback(host: Host, rules: Rules, to: str | None, on_event: Callable[[Event], None]) -> Event:
    """Take the robot back to an older release: `to`, or the newest healthy one."""
    return host.ask({"verb": "rollback", "rules": asdict(rules), "to": to, "by": whoami()}, on_event)


def status(host: Host, *, verify: bool) -> Event:
    """What is on the robot."""
    return host.ask({"verb": "status", "verify": verify}, lambda _: None)

# SPDX-License-Identifier: MIT
"""Updates of a booted robot by the image's own `segway-ecc deploy push`, over its own ssh."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from segway_ecc.deploy.image.build import build_wheel
from segway_ecc.deploy.image.recipe import image_cache
from tests.deploy.image.robot import Robot

RELEASES: Final = "/opt/segway-ecc/releases/"
_KEYS: Final = """mkdir -p /etc/ssh/authorized_keys /run/ssh
ssh-keygen -q -t ed25519 -N '' -f /run/ssh/key
cp /run/ssh/key.pub /etc/ssh/authorized_keys/root"""
_CONFIG: Final = """Host robot
 HostName 127.0.0.1
 User root
 IdentityFile /run/ssh/key
 StrictHostKeyChecking no
 UserKnownHostsFile /run/ssh/known
 LogLevel ERROR
"""
_ROBOT: Final = """name: {name}
model: {{source: "{name}:Model"}}
arming: at_start
hardware:
  type: wheel_board
  can: {{interface: auto, channel: auto, bitrate: 500000}}
  watchdog_s: 0.05
wiring: {{Left: left.voltage, Right: right.voltage}}
simulation: {{plant: "segway_ecc.hil.plants.cart:CartPlant"}}
"""
# A slow one keeps its rate for two seconds, so that it is started before it fails.
_MODEL: Final = '''"""A robot that stands still."""

import time

from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel


class Model(SectionedModel):
    name = "{name}"
    step_size = 0.02
    method = Method.DISCRETE
    outputs = (Variable("Left", "V"), Variable("Right", "V"))
    steps = 0

    def output(self):
        self.steps += 1
        time.sleep({sleep_s} if self.steps > 100 else 0.0)
        return (0.0, 0.0)
'''
_PUSH: Final = (
    "XDG_CACHE_HOME=/run/share/cache {command} deploy push robot --ssh-config /run/share/ssh_config --wheel {wheel} "
    "--ros none --robot /run/share/{name}/robot.yaml --start {start_s} --json"
)


@dataclass(frozen=True)
class Updates:
    """What is pushed onto a machine lies in the folder that it shares with the host.

    Attributes:
        robot: The robot on the machine.
        wheel: Our wheel, in that folder.
        command: The image's own `segway-ecc`: a release that was pushed has no pip to push others with.
    """

    robot: Robot
    wheel: str = ""
    command: str = ""

    @classmethod
    def on(cls, robot: Robot, epoch: int, python: str) -> "Updates":
        """Let the machine reach itself over ssh, and give it our wheel and all that it needs."""
        share = robot.machine.share
        wheels = share / "cache" / "segway-ecc" / "wheels" / f"manylinux_2_36_x86_64-cp{python.replace('.', '')}"
        shutil.copytree(image_cache() / f"wheels-{python}-ros", wheels)
        (share / "ssh_config").write_text(_CONFIG, "ascii")
        robot.machine.run(_KEYS)
        command = robot.machine.run("readlink -f /usr/bin/segway-ecc").strip()
        return cls(robot, f"/run/share/{build_wheel(share, epoch).name}", command)

    def make(self, name: str, sleep_s: float) -> None:
        """A robot file and its model, whose step lasts so long after two seconds, s."""
        folder = self.robot.machine.share / name
        folder.mkdir()
        (folder / "robot.yaml").write_text(_ROBOT.format(name=name), "ascii")
        (folder / f"{name}.py").write_text(_MODEL.format(name=name, sleep_s=sleep_s), "ascii")

    def push(self, name: str, start_s: float) -> tuple[int, dict[str, Any]]:
        """Push it; the exit code, and its output."""
        machine = self.robot.machine
        words = self._words(name, start_s)
        code = machine.run(f"{words} > /run/share/output 2> /run/share/{name}.err < /dev/null; echo $?", 900)
        Path(machine.share, f"{name}.journal").write_text(self.robot.journal(), "utf-8")  # for whoever mends it
        output = Path(machine.share, "output").read_text("utf-8")
        assert output, Path(machine.share, f"{name}.err").read_text("utf-8")
        return int(code), json.loads(output)

    def begin(self, name: str) -> None:
        """Push it, and return as soon as it is on trial."""
        machine = self.robot.machine
        machine.run(f"{self._words(name, 300)} > /dev/null 2> /run/share/{name}.err < /dev/null &")
        machine.wait_until('grep -q \'"phase": "trial"\' /opt/segway-ecc/transaction.json', 900)

    def current(self) -> str:
        """The release in use."""
        return self.robot.machine.run("readlink /opt/segway-ecc/current").strip().removeprefix("releases/")

    def running(self) -> str:
        """The release that the node was started from."""
        pid = self.robot.property("MainPID")
        words = self.robot.machine.run(f"tr '\\0' ' ' < /proc/{pid}/cmdline; readlink /proc/{pid}/cwd")
        assert "segway-ecc run" in words
        maps = self.robot.machine.run(f"grep -o '{RELEASES}[^/]*' /proc/{pid}/maps | sort -u").split()
        assert len(maps) == 1
        return maps[0].removeprefix(RELEASES)

    def _words(self, name: str, start_s: float) -> str:
        return _PUSH.format(command=self.command, wheel=self.wheel, name=name, start_s=start_s)

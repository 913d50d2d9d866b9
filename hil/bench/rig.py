"""The folder that one rate is measured in: the robot, its model, and the C programs, compiled."""

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.links.local_socket import multicast_group
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.native.load import load_native

_OURS: Final = Path(__file__).parent
_STEP: Final = "xx_step_size = 0.01;"
_C: Final = ("-O2", "-std=gnu11", "-Wall")


@dataclass(frozen=True, slots=True)
class Bus:
    """Where the programs and the plant meet.

    Attributes:
        interface: `socketcan` or `local`.
        channel: The programs' channel.
        plant_channel: The plant's; on real controllers another one than the programs'.
    """

    interface: str
    channel: str
    plant_channel: str

    def place(self, channel: str) -> str:
        """A channel as the C programs take it: they know no names of local buses."""
        return multicast_group(channel) if self.interface == "local" else channel


@dataclass(frozen=True, slots=True)
class BenchPrograms:
    """What is needed to run every program at one rate.

    Attributes:
        robot: The robot file.
        library: The model as a shared object with 20-sim's own interface.
        loop: The minimal loop in C, the model in it.
        board: The plant.
        period_ns: The period, ns.
    """

    robot: Path
    library: Path
    loop: Path
    board: Path
    period_ns: int


def missing() -> str | None:
    """What the comparison lacks here, with the remedy; None where it lacks nothing."""
    return None if shutil.which("cc") else "no C compiler here (sudo apt-get install gcc)"


def make_rig(folder: Path, period_ns: int) -> BenchPrograms:
    """Write and compile everything for one rate.

    Args:
        folder: An empty folder.
        period_ns: The period, ns.

    Raises:
        ConfigurationError: It does not compile.
    """
    model, robot = folder / "controller", folder / "bench-cart.yaml"
    shutil.copytree(_OURS / "controller", model)
    shutil.copyfile(_OURS / robot.name, robot)
    _set_step(model / "xxmodel.c", period_ns * 1e-9)
    sources = sorted(map(str, model.glob("*.c")))
    programs = _OURS / "programs"
    bus = [str(programs / "bus.c"), f"-I{programs}"]
    load_native(model)  # into the cache, so that the first start is as the next ones
    rig = BenchPrograms(robot, folder / "controller.so", folder / "loop", folder / "board", period_ns)
    _compile([*sources, "-shared", "-fPIC", "-lm", "-o", str(rig.library)])
    _compile([str(programs / "loop.c"), *bus, f"-I{model}", *sources, "-lm", "-o", str(rig.loop)])
    _compile([str(programs / "board.c"), *bus, "-o", str(rig.board)])
    return rig


def _set_step(source: Path, step_s: float) -> None:
    """Have the code step at another rate than it was generated for, as whoever generates it anew would."""
    text = source.read_text(encoding="utf-8")
    if text.count(_STEP) != 1:
        raise ConfigurationError(f"{source.name} of the bench's model does not contain `{_STEP}`")
    source.write_text(text.replace(_STEP, f"xx_step_size = {step_s!r};"), encoding="utf-8")


def _compile(arguments: Sequence[str]) -> None:
    done = subprocess.run(["cc", *_C, *arguments], capture_output=True, text=True, check=False)  # noqa: S603, S607 - the compiler of this machine, and no shell reads our words
    if done.returncode != 0:
        errors = done.stderr.strip().splitlines() or ["no message"]
        raise ConfigurationError(f"the programs of the bench do not compile: {errors[-1]}")

# SPDX-License-Identifier: MIT
"""What one rate is measured with: the bus, the robot, its model, and the C programs, compiled."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import segway_ecc.node.models
from segway_ecc.firmware_io.links.can_interfaces import read_interface_state, socketcan_interfaces
from segway_ecc.firmware_io.links.local_port import multicast_group
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.native.compile import run_compiler
from segway_ecc.node.native.load import load_native

_OURS: Final = Path(__file__).parent
_SUBMODEL: Final = Path(segway_ecc.node.models.__file__).with_name("cart_submodel")
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


def copy_controller(folder: Path) -> None:
    """Put the model together in a new folder: its equations, and the code that 20-sim writes for every submodel."""
    shutil.copytree(_SUBMODEL, folder)
    shutil.copytree(_OURS / "controller", folder, dirs_exist_ok=True)


def make_rig(folder: Path, period_ns: int) -> BenchPrograms:
    """Write and compile everything for one rate.

    Args:
        folder: An empty folder.
        period_ns: The period, ns.

    Raises:
        ConfigurationError: It does not compile.
    """
    model, robot = folder / "controller", folder / "bench-cart.yaml"
    copy_controller(model)
    shutil.copyfile(_OURS / robot.name, robot)
    # The code steps at another rate than it was generated for, as whoever generates it anew would have it.
    source = model / "xxmodel.c"
    text = source.read_text(encoding="utf-8")
    if text.count(_STEP) != 1:
        raise ConfigurationError(f"{source.name} of the bench's model does not contain `{_STEP}`")
    source.write_text(text.replace(_STEP, f"xx_step_size = {period_ns * 1e-9!r};"), encoding="utf-8")
    sources = sorted(map(str, model.glob("*.c")))
    programs = _OURS / "programs"
    bus = [str(programs / "bus.c"), f"-I{programs}"]
    load_native(model)  # into the cache, so that the first start is as the next ones
    rig = BenchPrograms(robot, folder / "controller.so", folder / "loop", folder / "board", period_ns)
    for words in (
        [*sources, "-shared", "-fPIC", "-lm", "-o", str(rig.library)],
        [str(programs / "loop.c"), *bus, f"-I{model}", *sources, "-lm", "-o", str(rig.loop)],
        [str(programs / "board.c"), *bus, "-o", str(rig.board)],
    ):
        code, output = run_compiler([*_C, *words])
        if code:
            errors = output.strip().splitlines() or ["no message"]
            raise ConfigurationError(f"the programs of the bench do not compile: {errors[-1]}")
    return rig


def virtual_interface() -> str | None:
    """The first virtual CAN interface of this machine that is up."""
    states = {name: read_interface_state(name) for name in socketcan_interfaces()}
    return next((name for name, state in states.items() if state.kind == "vcan" and state.is_up), None)


def choose_bus(channel: str | None, plant_channel: str | None) -> Bus:
    """The bus of the comparison.

    A real interface is used only where it is named: what is sent there would reach motors.

    Args:
        channel: A CAN interface of the kernel; None for a virtual one that is up, and else for a local bus.
        plant_channel: The plant's, where that is another controller on the same bus.
    """
    if channel is not None:
        return Bus("socketcan", channel, plant_channel or channel)
    name = virtual_interface()
    if name is not None:
        return Bus("socketcan", name, name)
    name = f"bench_{os.getpid()}"
    return Bus("local", name, name)


_NAME: Final = "XDG_CACHE_HOME"


@contextlib.contextmanager
def own_cache() -> Iterator[None]:
    """Have this process and those it starts keep compiled models in a folder that goes with the context."""
    before = os.environ.get(_NAME)
    with tempfile.TemporaryDirectory(prefix="segway-ecc-bench-") as folder:
        os.environ[_NAME] = folder
        try:
            yield
        finally:
            os.environ.pop(_NAME)
            if before is not None:
                os.environ[_NAME] = before

# SPDX-License-Identifier: MIT
"""What one rate is measured with: the bus, the robot, its model, and the C programs, compiled.

And under which conditions the programs run: the same for all of them, and reported.
"""

import contextlib
import os
import resource
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import segway_ecc.node.models
from segway_ecc.firmware_io.links.can_interfaces import read_interface_state, socketcan_interfaces
from segway_ecc.firmware_io.links.can_ports import multicast_group
from segway_ecc.hil.processes import inherited
from segway_ecc.node.cycle import cycle
from segway_ecc.node.cycle.real_time import (
    IDLE_LATENCY,
    PRIORITY,
    isolated_processors,
    no_deep_idle,
    real_time_priority,
)
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.native.compile import run_compiler
from segway_ecc.node.native.load import load_native

PLANT_PRIORITY: Final = PRIORITY + 10
"""Above the loops: a real board is not kept waiting by what commands it."""
_OURS: Final = Path(__file__).parent
_SUBMODEL: Final = Path(segway_ecc.node.models.__file__).with_name("cart_submodel")
_STEP: Final = "xx_step_size = 0.01;"
_C: Final = ("-O2", "-std=gnu11", "-Wall")


@dataclass(frozen=True, slots=True)
class Bus:
    """Where the programs and the plant meet, by `socketcan` or `local`.

    The channel is the programs'; on real controllers the plant has another one.
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

    The library is the model as a shared object with 20-sim's own interface, the loop the minimal one in C, the model in
    it, and the board the plant.
    """

    robot: Path
    library: Path
    loop: Path
    board: Path
    period_ns: int


def copy_controller(folder: Path) -> None:
    """Put the model together in a new folder: its equations, and the code that 20-sim writes for every submodel."""
    shutil.copytree(_SUBMODEL, folder)
    shutil.copytree(_OURS / "controller", folder, dirs_exist_ok=True)


def make_rig(folder: Path, period_ns: int) -> BenchPrograms:
    """Write and compile everything for one rate, in an empty folder.

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
    """The bus of the comparison: a CAN interface of the kernel; unnamed, a virtual one that is up, else a local bus.

    A real interface is used only where it is named: what is sent there would reach motors. The plant's channel is named
    where that is another controller on the same bus.
    """
    if channel is not None:
        return Bus("socketcan", channel, plant_channel or channel)
    virtual, local = virtual_interface(), f"bench_{os.getpid()}"
    return Bus("socketcan", virtual, virtual) if virtual is not None else Bus("local", local, local)


@contextlib.contextmanager
def own_cache() -> Iterator[None]:
    """Have this process and those it starts keep compiled models in a folder that goes with the context."""
    with tempfile.TemporaryDirectory(prefix="segway-ecc-bench-") as folder, inherited("XDG_CACHE_HOME", folder):
        yield


@dataclass(frozen=True, slots=True)
class Conditions:
    """What every program has, where this machine gives it.

    Attributes:
        priority: Of SCHED_FIFO; 0 where it is not to be had.
        idle_states_off: Whether the processors are kept from their sleeping states while the programs run.
        isolated: Those that were set aside for them; empty where none were.
        kernel: Its release and kind.
        is_compiled: Whether our own loop is, which the others have no choice in.
        is_subscribed: Whether a subscriber receives what they publish.
    """

    priority: int
    idle_states_off: bool
    memory_locked: bool
    cores: int
    isolated: tuple[int, ...]
    kernel: str
    is_compiled: bool = False
    is_subscribed: bool = False

    def as_text(self) -> str:
        """One line."""
        facts = [
            f"SCHED_FIFO {self.priority}" if self.priority else "ordinary scheduling (no real-time priority)",
            "idle states off" if self.idle_states_off else f"idle states on ({IDLE_LATENCY} is not to be had)",
            "memory locked" if self.memory_locked else "memory not locked",
            f"{self.cores} cores",
            f"isolated {self.isolated}" if self.isolated else "none isolated",
            f"Linux {self.kernel}",
            "with a subscriber" if self.is_subscribed else "without subscribers",
        ]
        ours = "compiled" if self.is_compiled else "not compiled"
        return f"{', '.join(facts)}; the same for all programs; ours is {ours}"


@contextlib.contextmanager
def held_conditions(*, is_subscribed: bool = False) -> Iterator[Conditions]:
    """Hold while the programs run what is held for all of them: no processor may go to sleep.

    `is_subscribed` is whether what they publish has a subscriber, which the caller starts.
    """
    with contextlib.ExitStack() as stack:
        with real_time_priority() as refusal:
            priority = 0 if refusal else PRIORITY
        uname = os.uname()
        yield Conditions(
            priority=priority,
            idle_states_off=stack.enter_context(no_deep_idle()) is None,
            memory_locked=resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY,
            cores=len(os.sched_getaffinity(0)),
            isolated=tuple(sorted(isolated_processors())),
            kernel=f"{uname.release}{' PREEMPT_RT' if 'PREEMPT_RT' in uname.version else ''}",
            is_compiled=not cycle.__file__.endswith(".py"),
            is_subscribed=is_subscribed,
        )

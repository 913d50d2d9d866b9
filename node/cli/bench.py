"""`segway-ecc bench`: how fast this machine runs the loop."""

import argparse
import dataclasses
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import msgspec

from hil.kernels import uml
from hil.processes import command
from node.case_study.can import ROBOT, LockstepCanSeat
from node.case_study.offline import SUBMODEL_CART, has_compiler
from node.cli.bench_links import links_cost, links_text
from node.cli.options import add_json, print_json
from node.errors import ConfigurationError
from node.native.cost import step_cost
from node.native.library import NativeModel
from node.native.load import load_native
from node.ros.runtime import missing_packages
from node.sequence.manoeuvre import single_segment

_REPETITIONS: Final = 5
_SIMULATED_S: Final = 10.0
_MARGIN_S: Final = 60.0
_COLUMNS: Final = {"p50": "p50_s", "p99": "p99_s", "p99.9": "p999_s", "max": "max_s"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `bench`."""
    add_json(parser)
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="length of the run in real time")


def run(options: argparse.Namespace) -> int:
    """Measure, and print what was measured."""
    if not options.duration > 0.0:
        raise ConfigurationError(f"--duration must be more than 0 s, not {options.duration}")
    sys.stderr.write(f"segway-ecc: lock step, {_REPETITIONS} times\n")
    lock_step = _lock_step()
    sys.stderr.write(f"segway-ecc: real time, {options.duration:g} s\n")
    real_time = _real_time(options.duration)
    native = _native() if has_compiler() else None
    links = _links()
    if options.json:
        print_json({"lock_step": lock_step, "native_model": native, "can_links": links, "real_time": real_time})
    else:
        _print(lock_step, real_time)
        _print_native(native)
        _print_links(links)
    return 0


def _lock_step() -> dict[str, float]:
    """The 10 s cell of the case study over the simulated bus: controller, bus and plant, without a log."""
    manoeuvre = single_segment(2.0, 2.0, _SIMULATED_S)
    seat = LockstepCanSeat(None)
    durations = []
    for _ in range(_REPETITIONS):
        start = time.perf_counter()
        seat.run("bench", manoeuvre)
        durations.append(time.perf_counter() - start)
    median = statistics.median(durations)
    return {"simulated_s": _SIMULATED_S, "median_s": median, "times_real_time": _SIMULATED_S / median}


def _real_time(duration_s: float) -> dict[str, Any]:
    """The controller in a process of its own, with ROS where it is there, the recorder, and a plant to talk to."""
    channel = ["--channel", f"bench_{os.getpid()}", "--interface", "local"]
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.TemporaryDirectory(prefix="segway-ecc-bench-") as name:
        folder = Path(name)
        node = ["run", ROBOT, *channel, "--duration", str(duration_s), "--json", "--namespace", f"/bench_{os.getpid()}"]
        node += ["--log", str(folder / "bench.mcap")]
        with (
            command(["plant", ROBOT, *channel], folder / "plant.txt"),
            command(node, folder / "node.txt", environment) as controller,
        ):
            result = controller.result(duration_s + _MARGIN_S)
    kept = ("cycles", "late", "overrun", "skipped", "mean_rate_hz", "timing")
    return {"ros": not missing_packages(), **{name: result[name] for name in kept}}


def _native() -> dict[str, float]:
    """The cart as a C submodel: loading it, and a step of it through our interface and from C."""
    with tempfile.TemporaryDirectory(prefix="segway-ecc-bench-") as cache:
        before = os.environ.get("XDG_CACHE_HOME")
        os.environ["XDG_CACHE_HOME"] = cache
        try:
            first_s, model = _timed_load()
            again_s, model = _timed_load()
            cost = step_cost(model)
        finally:
            os.environ.pop("XDG_CACHE_HOME")
            if before is not None:
                os.environ["XDG_CACHE_HOME"] = before
    return {"load_first_s": first_s, "load_from_cache_s": again_s, **dataclasses.asdict(cost)}


def _links() -> dict[str, float] | None:
    """A cycle over the kernel's CAN: here where it has a virtual interface, else in a kernel that has one."""
    cost = links_cost()
    if cost is not None or uml.available() is not None:
        return cost
    sys.stderr.write("segway-ecc: CAN links, in user-mode Linux\n")
    measure = [sys.executable, "-m", "node.cli.bench_links", "--json"]
    said = uml.run_in_guest(measure, cwd=Path.cwd(), interfaces=("vcan0",)).output
    return msgspec.json.decode(said, type=dict[str, float])


def _timed_load() -> tuple[float, NativeModel]:
    start = time.perf_counter()
    model = load_native(Path(SUBMODEL_CART.source))
    return time.perf_counter() - start, model


def _print_native(native: dict[str, float] | None) -> None:
    if native is None:
        sys.stdout.write("native model: no C compiler here (sudo apt-get install gcc)\n")
        return
    ours, theirs = native["through_our_interface_s"] * 1e6, native["native_s"] * 1e6
    sys.stdout.write(
        f"native model: a step costs {ours:.2f} us through our interface and {theirs:.2f} us from C (medians); "
        f"loaded in {native['load_first_s']:.2f} s the first time and "
        f"{native['load_from_cache_s'] * 1e3:.0f} ms from the cache\n"
    )


def _print_links(links: dict[str, float] | None) -> None:
    if links is None:
        sys.stdout.write(
            "CAN links: no SocketCAN here, and no user-mode Linux (sudo apt-get install user-mode-linux)\n"
        )
    else:
        sys.stdout.write(links_text(links) + "\n")


def _print(lock_step: dict[str, float], real_time: dict[str, Any]) -> None:
    write = sys.stdout.write
    write(
        f"lock step: {lock_step['simulated_s']:g} s over the simulated bus in {lock_step['median_s']:.3f} s (median of "
        f"{_REPETITIONS}), {lock_step['times_real_time']:.0f} times real time\n"
    )
    ros = "with ROS" if real_time["ros"] else "without ROS"
    write(f"real time, {ros}: {real_time['cycles']} cycles at {real_time['mean_rate_hz']:.4f} Hz, ")
    write(f"{real_time['late']} late, {real_time['skipped']} skipped; in microseconds:\n")
    write(f"{'phase':<10}" + "".join(f"{column:>10}" for column in _COLUMNS) + "\n")
    for phase, summary in real_time["timing"].items():
        write(f"{phase:<10}" + "".join(f"{summary[key] * 1e6:>10.1f}" for key in _COLUMNS.values()) + "\n")

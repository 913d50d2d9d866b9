# SPDX-License-Identifier: MIT
"""The seats of the case study, offline and behind ROS, and its conduct; see `segway_ecc.hil.case_study.can` for CAN's.

A seat is an environment that runs the model and returns where the cart went. Runs in real time that fail are repeated,
and which they were and why is kept.
"""

import csv
import dataclasses
import itertools
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Final, NamedTuple, Protocol, TypeVar

import msgspec

import segway_ecc.node.models
from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.firmware_io.errors import SegwayEccError
from segway_ecc.hil.case_study.study import Cell, Edge, RealTimeRun, Seat, Study, Trajectory, difference, thesis_cells
from segway_ecc.hil.errors import RigError, RunFailedError
from segway_ecc.hil.processes import ProcessFailedError, command, own_ros_domain
from segway_ecc.node.cycle.trajectory import cycle_at
from segway_ecc.node.errors import (
    NobodyListensError,
    NodeError,
    RecordingError,
    RobotLostError,
    RosUnavailableError,
    SequenceError,
)
from segway_ecc.node.models.load import load_model
from segway_ecc.node.recording.mcap_log import McapLog
from segway_ecc.node.ros.runtime import require_ros
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry, Segment, points, single_segment

OnProgress = Callable[[Seat, int, int], None]
"""Called with the seat, how many of its runs are done, and how many there are."""

DURATION_S: Final = 10.0
TURN: Final = "turn"
TRIES: Final = 3
"""Of a run in real time; what runs on a simulated clock, or on none, is never repeated."""

_REMEDY: Final = (
    "end other programs on this machine, and what stops or kills processes of the study, and try again; "
    "or choose other seats with --seat"
)
_LOSSES: Final = (
    None,
    -signal.SIGKILL,
    RosUnavailableError.exit_code,
    NobodyListensError.exit_code,
    RobotLostError.exit_code,
    RecordingError.exit_code,
    SequenceError.exit_code,
)
"""How a process ends that may succeed the next time: not in time (None), killed as for want of memory, or by a loss.
ROS is here when a study begins: where a process has none, it did not start."""
_T = TypeVar("_T")
_TURN_MANOEUVRE: Final = Manoeuvre(
    segments=(
        Segment(linear=1.0, angular=0.5, duration=DURATION_S),
        Segment(linear=1.0, angular=-0.5, duration=DURATION_S),
    )
)
_OUTPUTS: Final = ("X", "Y", "Heading", "LinearVelocity", "AngularVelocity")
_MARGIN_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class SeatRun:
    """What came of one manoeuvre.

    Attributes:
        trajectory: The cart's way; its last point is the end of the manoeuvre.
        graph: The ROS graph while it ran; empty without ROS.
    """

    trajectory: Trajectory
    graph: Sequence[Edge] = ()

    @property
    def position(self) -> tuple[float, float]:
        """Where the cart was at the end, m."""
        return self.trajectory.x[-1], self.trajectory.y[-1]


class SeatRunner(Protocol):
    """A seat, ready to run manoeuvres.

    Attributes:
        jobs: How many runs may go on side by side.
        tries: How many times a run may fail.
    """

    seat: Seat
    jobs: int
    tries: int

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Play a manoeuvre to a cart that stands at the origin.

        Args:
            name: A name for the run, unique in the study; letters, digits and underscores.
            manoeuvre: What to play.
        """


def trajectory(seat: Seat, points: Sequence[Odometry]) -> Trajectory:
    """The trajectory through points whose stamps are counted from the first."""
    first_ns = points[0].stamp_ns
    return Trajectory(
        seat=seat,
        time=[(p.stamp_ns - first_ns) * 1e-9 for p in points],
        x=[p.x for p in points],
        y=[p.y for p in points],
        linear_velocity=[p.linear_velocity for p in points],
        angular_velocity=[p.angular_velocity for p in points],
    )


class Cart(NamedTuple):
    """A model of the cart: what `load_model` takes, and the names of its two set-point states."""

    source: str
    linear: str
    angular: str


PYTHON_CART: Final = Cart("segway_ecc.node.models.cart:Cart", "LinearSetpoint", "AngularSetpoint")
SUBMODEL_CART: Final = Cart(
    str(Path(segway_ecc.node.models.__file__).with_name("cart_submodel")),
    r"Setpoints\LinearSetpoint",
    r"Setpoints\AngularSetpoint",
)


class OfflineSeat:
    """No clock, no bus, no ROS: what every other seat is compared with."""

    jobs = 1
    tries = 1

    def __init__(self, logs: Path, seat: Seat = Seat.OFFLINE, cart: Cart = PYTHON_CART) -> None:
        """Keep the logs of the runs in a folder; `cart` is the model that sits in the seat."""
        self.seat = seat
        self._logs = logs
        self._cart = cart

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Step the cart through a manoeuvre; see `SeatRunner.run`."""
        points = _step(self._cart, manoeuvre)
        with McapLog(self._logs / f"{self.seat}_{name}.mcap") as log:
            for point in points:
                log.odometry("/odom", *point)
                log.point("/position", point.stamp_ns, point.x, point.y, 0.0)
                log.float64("/linear_velocity", point.stamp_ns, point.linear_velocity)
                log.float64("/angular_velocity", point.stamp_ns, point.angular_velocity)
        return SeatRun(trajectory(self.seat, points))


def _step(cart: Cart, manoeuvre: Manoeuvre) -> list[Odometry]:
    """The cart after each step of a manoeuvre, stamped with model time."""
    model = load_model(cart.source)
    names = [v.name for v in model.outputs]
    odometry = itemgetter(*(names.index(output) for output in _OUTPUTS))
    period_ns = round(model.step_size * NS_PER_S)
    found = [odometry(model.initialize(()))]
    for (start_ns, (linear, angular)), (end_ns, _) in itertools.pairwise(points(manoeuvre)):
        model.write(cart.linear, linear)
        model.write(cart.angular, angular)
        cycles = range(cycle_at(start_ns, period_ns), cycle_at(end_ns, period_ns))
        found += [odometry(model.step(())) for _ in cycles]
    return [Odometry(cycle * period_ns, *y) for cycle, y in enumerate(found)]


class RosSeat:
    """Set-points and odometry cross DDS; each run lives in a namespace of its own.

    A run that is not bit-identical to the model alone has failed: something was lost on the way, or late.
    """

    seat = Seat.ROS
    jobs = 7
    tries = TRIES

    def __init__(self, folder: Path, logs: Path) -> None:
        """Keep messages in `folder` and logs in `logs`.

        Raises:
            RosUnavailableError: ROS is not there.
        """
        require_ros()
        self._folder = folder
        self._logs = logs
        # A study must not exchange messages with a real robot: it stays on this machine and in a domain of its own.
        self._environment = own_ros_domain() | {"ROS_LOG_DIR": str(folder / "ros")}

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Play a manoeuvre through ROS; see `SeatRunner.run`."""
        namespace = f"/{name}"
        file, odometry = self._folder / f"ros_{name}.yaml", self._folder / f"ros_{name}.csv"
        file.write_bytes(msgspec.yaml.encode(manoeuvre))
        node = ["run", "cart", "--ros", "--namespace", namespace, "--log", str(self._logs / f"ros_{name}.mcap")]
        sequence = ["sequence", str(file), "--namespace", namespace, "--json", "--csv", str(odometry), "--wait", "60"]
        with (
            command(node, self._folder / f"ros_{name}.node.txt", self._environment) as robot,
            command(sequence, self._folder / f"ros_{name}.sequence.txt", self._environment) as player,
        ):
            result = player.result(manoeuvre.duration_ns * 1e-9 + 2 * _MARGIN_S, robot)
        graph = tuple(Edge(**edge) for edge in result["graph"])
        with odometry.open(newline="", encoding="utf-8") as lines:
            rows = csv.reader(lines)
            next(rows)
            points = [Odometry(int(stamp_ns), *map(float, values)) for stamp_ns, *values in rows]
        found, expected = (trajectory(Seat.ROS, each) for each in (points, _step(PYTHON_CART, manoeuvre)))
        if found != expected:
            ended = difference((found.x[-1], found.y[-1]), (expected.x[-1], expected.y[-1]))
            raise RigError(
                f"what came through ROS is not bit-identical to the offline run: {len(found.x)} of {len(expected.x)} "
                f"points, the last one {ended:.3g} m off"
            )
        return SeatRun(found, graph)


def _is_loss(error: SegwayEccError) -> bool:
    """Whether a stall of the machine, or what is lost in one, may have caused it: then it need not fail again."""
    if isinstance(error, ProcessFailedError):
        return error.ended_with in _LOSSES
    return isinstance(error, RigError)


class Repeats:
    """Repeats what fails by a loss or a stall, which a file or an installation that does not fit is not.

    Attributes:
        causes: A line for each run that was repeated, with the reason.
    """

    def __init__(self, on_repeat: Callable[[str], object] = lambda _cause: None) -> None:
        """Call `on_repeat` with each line of `causes`."""
        self.causes: list[str] = []
        self._on_repeat = on_repeat

    def run(self, what: str, tries: int, once: Callable[[str], _T], is_over: Callable[[], bool] = lambda: False) -> _T:
        """Run `once` until it succeeds.

        Args:
            what: Names it in messages.
            tries: How many times it may fail by a loss or a stall.
            once: Called with a suffix for the names of this try's files, empty in the first one.
            is_over: Whether nothing is to be repeated any more.

        Raises:
            NodeError, RigError: It failed, and may not be repeated.
            RunFailedError: It failed in each of several tries.
        """
        failures: list[SegwayEccError] = []
        while True:
            try:
                return once(f"_try_{len(failures) + 1}" if failures else "")
            except (NodeError, RigError) as error:
                failures.append(error)
                if tries == 1 or is_over() or not _is_loss(error):
                    raise
                if len(failures) == tries:
                    text = f"{what} failed in each of {tries} tries, the last time: {error}; {_REMEDY}"
                    raise RunFailedError(text, failures) from error
                self.causes.append(f"{what}, try {len(failures)} of {tries}: {error}")
                self._on_repeat(self.causes[-1])


def conduct(
    runners: Sequence[SeatRunner], facts: Mapping[str, str], on_progress: OnProgress, repeats: Repeats | None = None
) -> Study:
    """Run the twelve cells and the turn in each seat; `repeats` is called with each run that is repeated.

    A seat in real time, one of whose runs the machine spoiled in each try, has no result, and fails no other seat.

    Raises:
        NodeError, RigError: A run failed as often as its seat may; the first one ends the study.
    """
    cells, repeats, spoiled = thesis_cells(), repeats or Repeats(), None
    runs: dict[Seat, dict[str, SeatRun]] = {}
    for runner in runners:
        try:
            runs[runner.seat] = _run_seat(runner, cells, on_progress, repeats)
        except RunFailedError as error:
            if not error.is_spoiled:
                raise
            spoiled = RealTimeRun("its table", failure=str(error), is_spoiled=True)
    turns = [of_seat[TURN].trajectory for of_seat in runs.values()]
    graphs = [of_seat[TURN].graph for of_seat in runs.values()]
    ends = [{seat: of_seat[cell_name(cell)].position for seat, of_seat in runs.items()} for cell in cells]
    return Study(
        cells=[dataclasses.replace(cell, positions=at) for cell, at in zip(cells, ends, strict=True)],
        seats=list(runs),
        velocities=[_first(turn, DURATION_S) for turn in turns],
        turn=turns,
        graph=next((graph for graph in graphs if graph), ()),
        facts=facts,
        repeated=repeats.causes,
        real_time=spoiled,
    )


def cell_name(cell: Cell) -> str:
    """A name for the cell's run."""
    return f"linear_{cell.linear:g}_angular_{cell.angular:g}"


def _run_seat(
    runner: SeatRunner, cells: Sequence[Cell], on_progress: OnProgress, repeats: Repeats
) -> dict[str, SeatRun]:
    # The longest first, so that it does not run alone at the end.
    manoeuvres = {TURN: _TURN_MANOEUVRE}
    manoeuvres |= {cell_name(cell): single_segment(cell.linear, cell.angular, DURATION_S) for cell in cells}
    on_progress(runner.seat, 0, len(manoeuvres))
    runs: dict[str, SeatRun] = {}
    over = threading.Event()

    def run(name: str, manoeuvre: Manoeuvre) -> SeatRun:
        def once(suffix: str) -> SeatRun:
            return runner.run(name + suffix, manoeuvre)

        return repeats.run(f"{runner.seat} {name}", runner.tries, once, over.is_set)

    with ThreadPoolExecutor(runner.jobs) as pool:
        futures = {pool.submit(run, name, manoeuvre): name for name, manoeuvre in manoeuvres.items()}
        try:
            for future in as_completed(futures):
                runs[futures[future]] = future.result()
                on_progress(runner.seat, len(runs), len(futures))
        finally:  # after a failure or Ctrl-C, what waits is not begun and what fails is not repeated
            over.set()
            for future in futures:
                future.cancel()
    return runs


def _first(whole: Trajectory, duration_s: float) -> Trajectory:
    count = sum(time <= duration_s for time in whole.time)
    fields = (field.name for field in dataclasses.fields(whole) if field.name != "seat")
    return dataclasses.replace(whole, **{name: getattr(whole, name)[:count] for name in fields})

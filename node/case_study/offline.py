"""The offline seat: the model alone, stepped in this process."""

from collections.abc import Iterator
from pathlib import Path

from node.case_study.seats import Run, trajectory
from node.case_study.study import Seat
from node.config import load_robot
from node.cycle.clock import NS_PER_S
from node.model.load import load_model
from node.recording.mcap_log import McapLog
from node.sequence.manoeuvre import Manoeuvre
from node.sequence.player import Odometry

_OUTPUTS = ("X", "Y", "Heading", "LinearVelocity", "AngularVelocity")


class OfflineSeat:
    """No clock, no bus, no ROS: what every other seat is compared with."""

    seat = Seat.OFFLINE
    jobs = 1

    def __init__(self, logs: Path) -> None:
        """Keep the logs of the runs in a folder."""
        self._logs = logs
        self._source = load_robot("cart").model.source

    def run(self, name: str, manoeuvre: Manoeuvre) -> Run:
        """Step the cart through a manoeuvre; see `SeatRunner.run`."""
        points = list(self._points(manoeuvre))
        with McapLog(self._logs / f"offline_{name}.mcap") as log:
            for stamp_ns, x, y, heading, linear, angular in points:
                log.odometry("/odom", stamp_ns, x, y, heading, linear, angular)
                log.point("/position", stamp_ns, x, y, 0.0)
                log.float64("/linear_velocity", stamp_ns, linear)
                log.float64("/angular_velocity", stamp_ns, angular)
        return Run(trajectory(Seat.OFFLINE, points))

    def _points(self, manoeuvre: Manoeuvre) -> Iterator[Odometry]:
        model = load_model(self._source)
        names = [v.name for v in model.outputs]
        indices = [names.index(output) for output in _OUTPUTS]
        period_ns = round(model.step_size * NS_PER_S)
        y = model.initialize(())
        stamp_ns = 0
        for segment in manoeuvre.segments:
            model.write("LinearSetpoint", segment.linear)
            model.write("AngularSetpoint", segment.angular)
            for _ in range(round(segment.duration / model.step_size)):
                yield Odometry(stamp_ns, *(y[index] for index in indices))
                y = model.step(())
                stamp_ns += period_ns
        yield Odometry(stamp_ns, *(y[index] for index in indices))

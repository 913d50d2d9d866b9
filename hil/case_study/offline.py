# SPDX-License-Identifier: MIT
"""The offline seats: a model alone, stepped in this process."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import segway_ecc.node.models
from segway_ecc.hil.case_study.seats import SeatRun, trajectory
from segway_ecc.hil.case_study.study import Seat
from segway_ecc.node.cycle.clock import NS_PER_S
from segway_ecc.node.models.load import load_model
from segway_ecc.node.recording.mcap_log import McapLog
from segway_ecc.node.sequence.manoeuvre import Manoeuvre
from segway_ecc.node.sequence.player import Odometry

_OUTPUTS: Final = ("X", "Y", "Heading", "LinearVelocity", "AngularVelocity")


@dataclass(frozen=True, slots=True)
class Cart:
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


def has_compiler() -> bool:
    """Whether this machine can compile a C submodel."""
    return shutil.which("gcc") is not None


class OfflineSeat:
    """No clock, no bus, no ROS: what every other seat is compared with."""

    jobs = 1

    def __init__(self, logs: Path, seat: Seat = Seat.OFFLINE, cart: Cart = PYTHON_CART) -> None:
        """Keep the logs of the runs in a folder; `cart` is the model that sits in the seat."""
        self.seat = seat
        self._logs = logs
        self._cart = cart

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Step the cart through a manoeuvre; see `SeatRunner.run`."""
        model = load_model(self._cart.source)
        names = [v.name for v in model.outputs]
        indices = [names.index(output) for output in _OUTPUTS]
        period_ns = round(model.step_size * NS_PER_S)
        y = model.initialize(())
        points: list[Odometry] = []
        for segment in manoeuvre.segments:
            model.write(self._cart.linear, segment.linear)
            model.write(self._cart.angular, segment.angular)
            for _ in range(round(segment.duration / model.step_size)):
                points.append(Odometry(len(points) * period_ns, *(y[index] for index in indices)))
                y = model.step(())
        points.append(Odometry(len(points) * period_ns, *(y[index] for index in indices)))
        with McapLog(self._logs / f"{self.seat}_{name}.mcap") as log:
            for point in points:
                log.odometry("/odom", *point)
                log.point("/position", point.stamp_ns, point.x, point.y, 0.0)
                log.float64("/linear_velocity", point.stamp_ns, point.linear_velocity)
                log.float64("/angular_velocity", point.stamp_ns, point.angular_velocity)
        return SeatRun(trajectory(self.seat, points))

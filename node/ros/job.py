"""What the process that speaks ROS is told when it starts: all that the robot is to the world."""

from typing import Final

import msgspec

from segway_ecc.node.config import RosSection
from segway_ecc.node.model.variables import Variable

_NUMBER_BYTES: Final = 9
"""Of MessagePack, at most."""
_REPORT_BYTES: Final = 1024
"""All else of a report, and as much as it needs of diagnostics."""


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """What the process is told first, as one line of JSON.

    Attributes:
        robot: What the robot's file calls it.
        ros: Names in ROS.
        namespace: Where the robot lives in the ROS graph.
        ros_arguments: What followed `--ros-args` on the command line, that flag included.
        period_ns: Of the loop, ns.
        published: The published signals, in the order of the wiring.
        topics: Topics that variables are published on, in the order of the wiring.
        set_names: Names of the values that anybody may set, in the order of the wiring.
        parameters: The model's parameters, each with the value that it has now.
        reports: File descriptor of the ring from the loop.
        inboxes: That of the ring to the loop.
    """

    robot: str
    ros: RosSection
    namespace: str
    ros_arguments: tuple[str, ...]
    period_ns: int
    published: tuple[str, ...]
    topics: tuple[str, ...]
    set_names: tuple[str, ...]
    parameters: tuple[Variable, ...]
    reports: int
    inboxes: int

    @property
    def report_bytes(self) -> int:
        """A report of a cycle, unless it has long reasons to tell."""
        numbers = len(self.published) + len(self.topics) + len(self.set_names)
        return _REPORT_BYTES + _NUMBER_BYTES * numbers

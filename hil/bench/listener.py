# SPDX-License-Identifier: MIT
"""`python -P -m segway_ecc.hil.bench.listener NAMESPACE`: subscribes to what a program publishes of each cycle.

It takes none of it, so that what is measured beside it is what publishing costs, and not what receiving does.
"""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from typing import Final

from segway_ecc.hil.processes import module_words
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import ros_node

TOPICS: Final = {"odom": "nav_msgs/msg/Odometry", "joint_states": "sensor_msgs/msg/JointState"}
"""Topics that any ROS 2 system subscribes to, and their types."""
_DEPTH: Final = 10


@contextlib.contextmanager
def listening(namespace: str) -> Iterator[None]:
    """Have `TOPICS` in a namespace subscribed to while the context lasts.

    Raises:
        ConfigurationError: ROS does not start there.
    """
    words = [*module_words(__name__), namespace]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:  # noqa: S603 - our own
        try:
            if process.stdout is None or process.stdout.readline() != b"ready\n":
                raise ConfigurationError("the listener of the bench does not start")
            yield
        finally:
            process.communicate()  # which closes its standard input, so that it ends


def main() -> None:
    """Subscribe, and wait for the end of standard input."""
    with ros_node("listener", sys.argv[1]) as node:
        subscriptions = [
            node.create_subscription(message_type(kind), topic, _never_called, _DEPTH) for topic, kind in TOPICS.items()
        ]
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.read()
        del subscriptions


def _never_called(_message: object) -> None:
    raise AssertionError("nothing is taken")


if __name__ == "__main__":
    main()

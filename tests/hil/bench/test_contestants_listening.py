# SPDX-License-Identifier: MIT
import os
import time
from pathlib import Path

import pytest

from segway_ecc.hil.bench.contestants import TOPICS, listening
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import ros_node
from tests.patience import PATIENCE_S
from tests.ros_domains import next_domain

pytestmark = pytest.mark.ros


@pytest.fixture(autouse=True)
def ros_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", next_domain())
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))


def test_each_topic_is_subscribed_to_for_as_long_as_is_wanted() -> None:
    namespace = f"/listened_{os.getpid()}"
    with ros_node("program", namespace) as node:
        publishers = [node.create_publisher(message_type(kind), topic, 10) for topic, kind in TOPICS.items()]

        def wait_until(wanted: int) -> None:
            deadline = time.monotonic() + PATIENCE_S
            while [publisher.get_subscription_count() for publisher in publishers] != [wanted] * len(publishers):
                assert time.monotonic() < deadline
                time.sleep(0.01)

        with listening(namespace):
            wait_until(1)
        wait_until(0)


def test_a_listener_that_does_not_start_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "no number")
    with pytest.raises(ConfigurationError, match="the listener of the bench does not start"), listening("/nobody"):
        pass

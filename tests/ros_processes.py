# SPDX-License-Identifier: MIT
"""Processes of these tests: each module has a ROS domain of its own, which never leaves this machine."""

import contextlib
import importlib.resources
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.patience import PATIENCE_S
from tests.ros_domains import next_domain

_TRIES = 2000

Start = Callable[..., "subprocess.Popen[str]"]
"""Called with a name for the process' messages and the words after `segway-ecc`."""
Ask = Callable[..., Any]
"""Called with what the foreign node is asked and its arguments; returns its answer."""


@pytest.fixture(scope="module")
def ros_environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return {
        **os.environ,
        "ROS_DOMAIN_ID": next_domain(),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path_factory.mktemp("ros_log")),
        "XDG_STATE_HOME": str(tmp_path_factory.mktemp("state")),
    }


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where each process' standard error goes, as `<name>.txt`."""
    return tmp_path_factory.mktemp("messages")


@contextlib.contextmanager
def _starting(environment: dict[str, str], messages: Path) -> Iterator[Start]:
    with contextlib.ExitStack() as stack:

        def started(name: str, *words: str, env: dict[str, str] | None = None) -> "subprocess.Popen[str]":
            with (messages / f"{name}.txt").open("w") as errors:
                process = subprocess.Popen(
                    [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    env={**environment, **(env or {})},
                    text=True,
                )
            stack.enter_context(process)
            stack.callback(process.kill)
            return process

        yield started


@pytest.fixture
def start(ros_environment: dict[str, str], messages: Path) -> Iterator[Start]:
    """Starts what ends with the test, so that a robot takes no time from the tests after it."""
    with _starting(ros_environment, messages) as start:
        yield start


@pytest.fixture(scope="module")
def start_for_all(ros_environment: dict[str, str], messages: Path) -> Iterator[Start]:
    """Starts what ends with the module."""
    with _starting(ros_environment, messages) as start:
        yield start


@pytest.fixture(scope="module")
def on_request(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A robot file of the cart that waits to be armed."""
    text = importlib.resources.files("segway_ecc.node").joinpath("robots/cart.yaml").read_text("utf-8")
    path = tmp_path_factory.mktemp("robot") / "cart-on-request.yaml"
    path.write_text(text.replace("arming: at_start", "arming: on_request"), "utf-8")
    return str(path)


@pytest.fixture(scope="module")
def foreign(ros_environment: dict[str, str]) -> Iterator[Ask]:
    """A node of somebody else's; see foreign_node.py."""
    with subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("node") / "ros" / "foreign_node.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=ros_environment,
        text=True,
    ) as process:
        questions, answers = process.stdin, process.stdout
        assert questions is not None
        assert answers is not None

        def ask(what: str, **arguments: Any) -> Any:
            questions.write(json.dumps({"do": what, **arguments}) + "\n")
            questions.flush()
            return json.loads(answers.readline())

        yield ask
        questions.close()


def receive_until(foreign: Ask, topic: str, wanted: Callable[[Any], bool]) -> Any:
    """The first message on a topic that is as wanted."""
    for _ in range(_TRIES):
        received = foreign("receive", topic=topic)
        assert received, f"nothing comes on {topic}"
        for message in received:
            if wanted(message):
                return message
    pytest.fail(f"no message on {topic} is as wanted; the last was {received[-1]}")


def output(process: "subprocess.Popen[str]") -> str:
    """What a process prints until it ends."""
    text, _ = process.communicate(timeout=PATIENCE_S)
    return text

# SPDX-License-Identifier: MIT
"""Run in a guest as root: a robot and a station in network namespaces of their own, netem on the wire between them.

`python netem_points.py FILE` writes what came of each point as JSON.
"""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

ENDS = {"robot": "10.99.0.1/24", "station": "10.99.0.2/24"}
STATION = Path(__file__).with_name("netem_station.py")
LATENCIES_MS = (0, 50, 200)
LOSSES = (0, 5)
PLAYED_S = 3.0
PARTITION_AT_S, PARTITION_S, PARTITIONED_S = 1.0, 2.0, 5.0


def call(*words: str) -> None:
    subprocess.run(words, check=True)


def inside(end: str) -> list[str]:
    return ["ip", "netns", "exec", end]


def make_network() -> None:
    for module in ("veth", "sch_netem"):
        call("modprobe", module)
    call("ip", "link", "add", "robot", "type", "veth", "peer", "name", "station")
    for end, address in ENDS.items():
        call("ip", "netns", "add", end)
        call("ip", "link", "set", end, "netns", end)
        for words in (
            ["ip", "address", "add", address, "dev", end],
            ["ip", "link", "set", "lo", "up"],
            ["ip", "link", "set", end, "up"],
            ["ip", "route", "add", "224.0.0.0/4", "dev", end],
        ):
            call(*inside(end), *words)


def shape(latency_ms: int, loss: int) -> None:
    """The same in both directions."""
    for end in ENDS:
        rule = ["delay", f"{latency_ms}ms", "loss", f"{loss}%", "limit", "10000"]
        call(*inside(end), "tc", "qdisc", "replace", "dev", end, "root", "netem", *rule)


def partition() -> None:
    time.sleep(PARTITION_AT_S)
    shape(0, 100)
    time.sleep(PARTITION_S)
    shape(0, 0)


def ask(station: "subprocess.Popen[str]", seconds: float, *, stamped: bool) -> Any:
    assert station.stdin is not None
    assert station.stdout is not None
    station.stdin.write(json.dumps({"seconds": seconds, "stamped": stamped}) + "\n")
    station.stdin.flush()
    return json.loads(station.stdout.readline())


def points(station: "subprocess.Popen[str]") -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    for stamped in (False, True):
        for loss in LOSSES:
            for latency_ms in LATENCIES_MS:
                shape(latency_ms, loss)
                said = ask(station, PLAYED_S, stamped=stamped)
                found.append({"stamped": stamped, "latency_ms": latency_ms, "loss": loss, "cut": False, "said": said})
        cutting = threading.Thread(target=partition)
        shape(0, 0)
        cutting.start()
        said = ask(station, PARTITIONED_S, stamped=stamped)
        cutting.join()
        found.append({"stamped": stamped, "latency_ms": 0, "loss": 0, "cut": True, "said": said})
    return found


def main(file: Path) -> None:
    make_network()
    shape(0, 0)
    environment = {**os.environ, "ROS_DOMAIN_ID": "7", "ROS_LOG_DIR": "/run/ros"}
    robot_words = [
        *inside("robot"),
        sys.executable,
        "-m",
        "segway_ecc.node.cli.main",
        "run",
        "cart",
        "--ros",
        "--no-log",
        "--json",
    ]
    station_words = [*inside("station"), sys.executable, str(STATION)]
    heard = file.with_name("robot.txt")
    with (
        heard.open("w") as errors,
        subprocess.Popen(robot_words, stdout=subprocess.PIPE, stderr=errors, env=environment, text=True) as robot,
        subprocess.Popen(
            station_words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
        ) as station,
    ):
        found = points(station)
        assert station.stdin is not None
        station.stdin.close()
        robot.terminate()
        told, _ = robot.communicate()
    file.write_text(json.dumps({"points": found, "robot": heard.read_text(), "told": json.loads(told)}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))

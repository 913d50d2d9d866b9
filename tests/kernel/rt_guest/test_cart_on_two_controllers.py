# SPDX-License-Identifier: MIT
"""The cart's node on can0 and its simulated plant on can1: each with a controller of its own, as on a robot."""

import json
import subprocess
import sys
from pathlib import Path

COMMAND = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main"]
ENDS_WITHIN_S = 90.0
HEARD_ON_CAN1 = Path("/sys/class/net/can1/statistics/rx_packets")


def test_node_and_plant_talk_over_the_controllers() -> None:
    plant_words = [*COMMAND, "plant", "cart-can", "--channel", "can1", "--json"]
    node_words = [*COMMAND, "run", "cart-can", "--channel", "can0", "--no-ros", "--no-log", "--json"]
    node_words += ["--duration", "15"]
    before = int(HEARD_ON_CAN1.read_text("ascii"))
    with subprocess.Popen(plant_words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as plant:
        try:
            assert plant.stderr is not None
            said = plant.stderr.readline()
            node = subprocess.run(node_words, check=False, capture_output=True, text=True, timeout=ENDS_WITHIN_S)
        finally:
            plant.terminate()
            plant.communicate(timeout=ENDS_WITHIN_S)

    assert "on socketcan can1" in said
    assert node.returncode == 0, node.stderr
    assert "on socketcan can0" in node.stderr
    (hardware,) = (v for k, v in json.loads(node.stdout)["diagnostics"].items() if k.endswith(": hardware"))
    # How many in that time depends on what else the machine does.
    assert int(hardware["link.sent"]) > 0
    assert int(hardware["link.received"]) > 0
    assert int(HEARD_ON_CAN1.read_text("ascii")) > before

# SPDX-License-Identifier: MIT
"""The verbs that a robot needs, one module each."""

from typing import Final

from segway_ecc.node.cli.verb import Section, list_verbs

_ROWS: Final = (
    ("run", "cart", "run a robot: the model node", Section.ROBOT),
    ("guard", "segway", "disable the drives when the node falls silent", Section.ROBOT),
    ("sequence", "1 0.5 10", "drive a robot through set-points, over ROS 2", Section.ROBOT),
    ("model", "inspect FOLDER", "a model alone", Section.MODEL),
    ("model inspect", "FOLDER", "ports, parameters and states with units, and the effect of writing each", "inspect"),
    ("model simulate", "FOLDER --duration 10", "run a model under given inputs", "simulate"),
    ("log", "replay run.mcap", "what was recorded", Section.OPERATION),
    (
        "log replay",
        "run.mcap",
        "a recorded run through the same model and safety code: identical, or the first difference",
        "replay",
    ),
    ("log repair", "run.mcap", "a whole log, for every tool, of one that was cut off or damaged", ""),
    ("log traffic", "cart-can --out traffic.log", "the raw traffic on a robot's bus as a candump log", "traffic"),
)
VERBS: Final = list_verbs(__name__, _ROWS)

# SPDX-License-Identifier: MIT
"""The verbs that a robot needs, one module each."""

from typing import Final

from segway_ecc.node.cli.verb import Section, Verb

VERBS: Final = (
    Verb("run", "run a robot: the model node", "segway-ecc run cart", __name__, Section.ROBOT),
    Verb("guard", "disable the drives when the node falls silent", "segway-ecc guard segway", __name__, Section.ROBOT),
    Verb(
        "sequence",
        "drive a robot through set-points, over ROS 2",
        "segway-ecc sequence 1 0.5 10",
        __name__,
        Section.ROBOT,
    ),
    Verb("model", "a model alone", "segway-ecc model inspect FOLDER", None, Section.MODEL),
    Verb(
        "model inspect",
        "ports, parameters and states with units, and the effect of writing each",
        "segway-ecc model inspect FOLDER",
        __name__,
        formerly="inspect",
    ),
    Verb(
        "model simulate",
        "run a model under given inputs",
        "segway-ecc model simulate FOLDER --duration 10",
        __name__,
        formerly="simulate",
    ),
    Verb("log", "what was recorded", "segway-ecc log replay run.mcap", None, Section.OPERATION),
    Verb(
        "log replay",
        "a recorded run through the same model and safety code: identical, or the first difference",
        "segway-ecc log replay run.mcap",
        __name__,
        formerly="replay",
    ),
    Verb(
        "log traffic",
        "the raw traffic on a robot's bus as a candump log",
        "segway-ecc log traffic cart-can --out traffic.log",
        __name__,
        formerly="traffic",
    ),
)

# SPDX-License-Identifier: MIT
"""The verbs that simulate, prove and measure, one module each."""

from typing import Final

from segway_ecc.node.cli.verb import Section, Verb

VERBS: Final = (
    Verb(
        "play",
        "a whole simulated robot on this machine, driven with the arrow keys",
        "segway-ecc play segway",
        __name__,
        Section.ROBOT,
    ),
    Verb(
        "plant",
        "the simulated plant and drives at the other end of a robot's bus",
        "segway-ecc plant cart-can",
        __name__,
        Section.ROBOT,
    ),
    Verb("design", "the controller of a balancing robot", "segway-ecc design gains segway", None, Section.MODEL),
    Verb(
        "design gains",
        "gains from what the robot is made of, with poles and stability margins",
        "segway-ecc design gains segway",
        __name__,
    ),
    Verb(
        "design margins",
        "the disturbance limits of the robot, found by search, against what is required",
        "segway-ecc design margins",
        __name__,
        formerly="margins",
    ),
    Verb(
        "case-study",
        "the thesis' tables and figures in each seat, side by side",
        "segway-ecc case-study",
        __name__,
        Section.PROOF,
    ),
    Verb("prove", "what happens when parts fail, and for hours", "segway-ecc prove campaign", None, Section.PROOF),
    Verb(
        "prove campaign",
        "every fault scenario, against its expected outcome",
        "segway-ecc prove campaign",
        __name__,
        formerly="campaign",
    ),
    Verb("prove fault", "one fault scenario in lock step", "segway-ecc prove fault can-cut", __name__, formerly="hil"),
    Verb(
        "prove kill-drill",
        "kill, stop and cut every part of a driving robot; time to zero torque",
        "segway-ecc prove kill-drill",
        __name__,
        formerly="kill-drill",
    ),
    Verb(
        "prove failover",
        "lose the bus in every way; time until the serial line takes over",
        "segway-ecc prove failover cart-can",
        __name__,
        formerly="failover",
    ),
    Verb(
        "prove endurance",
        "hours of normal driving in lock step with lost frames: nothing may trip",
        "segway-ecc prove endurance segway",
        __name__,
        formerly="endurance",
    ),
    Verb(
        "prove soak",
        "hours in lock step and half an hour in real time: memory, files and threads must not grow",
        "segway-ecc prove soak",
        __name__,
        formerly="soak",
    ),
    Verb(
        "prove placement",
        "sequence, balance and supervision, each on the robot or on the base station",
        "segway-ecc prove placement --quick",
        __name__,
        formerly="study placement",
    ),
    Verb(
        "prove growth",
        "the cost of a cycle by model ports, drives, subscribers and robots",
        "segway-ecc prove growth --quick",
        __name__,
        formerly="study growth",
    ),
    Verb(
        "bench",
        "the speed of the loop here, beside a user's loop and one in C",
        "segway-ecc bench",
        __name__,
        Section.PROOF,
    ),
)

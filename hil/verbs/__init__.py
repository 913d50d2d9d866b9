# SPDX-License-Identifier: MIT
"""The verbs that simulate, prove and measure, one module each."""

from typing import Final

from segway_ecc.node.cli.verb import Section, list_verbs

_ROWS: Final = (
    ("demo", "", "a simulated robot and its base station in the browser: see it, push it, break it", Section.ROBOT),
    ("play", "segway", "a whole simulated robot on this machine, driven with the arrow keys", Section.ROBOT),
    ("plant", "cart-can", "the simulated plant and drives at the other end of a robot's bus", Section.ROBOT),
    ("lock-step", "cart", "a simulated robot in ROS on simulated time, with /clock", Section.ROBOT),
    ("design", "gains segway", "the controller of a balancing robot", Section.MODEL),
    ("design gains", "segway", "gains from what the robot is made of, with poles and stability margins", ""),
    ("design margins", "", "the disturbance limits of the robot, found by search, against what is required", "margins"),
    ("design commission", "robot.yaml", "the first hour with a real robot, step by step, and the report of it", ""),
    (
        "log compare",
        "run.mcap",
        "a recorded run beside the simulation of the same commands: plots, and residuals by signal",
        "",
    ),
    ("design identify", "run.mcap", "what the robot is made of, from logs of its runs, and the gains for that", ""),
    ("case-study", "", "the thesis' tables and figures in each seat, side by side", Section.PROOF),
    ("prove", "campaign", "what happens when parts fail, and for hours", Section.PROOF),
    ("prove campaign", "", "every fault scenario, against its expected outcome", "campaign"),
    ("prove floor", "", "a segway on floors, slopes and obstacles, pushed and with other parameters", ""),
    ("prove fault", "can-cut", "one fault scenario in lock step", "hil"),
    ("prove kill-drill", "", "kill, stop and cut every part of a driving robot; time to zero torque", "kill-drill"),
    ("prove inputs", "", "every kind of wrong input to a robot that runs: outcome, reason, time to zero torque", ""),
    ("prove failover", "cart-can", "lose the bus in every way; time until the serial line takes over", "failover"),
    (
        "prove endurance",
        "segway",
        "hours of normal driving in lock step with lost frames: nothing may trip",
        "endurance",
    ),
    (
        "prove soak",
        "",
        "hours in lock step and half an hour in real time: memory, files and threads must not grow",
        "soak",
    ),
    (
        "prove placement",
        "--quick",
        "sequence, balance and supervision, each on the robot or on the base station",
        "study placement",
    ),
    ("prove growth", "--quick", "the cost of a cycle by model ports, drives, subscribers and robots", "study growth"),
    ("bench", "", "the speed of the loop here, beside a user's loop and one in C", Section.PROOF),
)
VERBS: Final = list_verbs(__name__, _ROWS)

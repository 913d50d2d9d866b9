# SPDX-License-Identifier: MIT
"""The verbs that put a robot into operation, one module each."""

from typing import Final

from segway_ecc.node.cli.verb import Section, Verb, list_verbs

_ROWS: Final = (
    ("station", "serve", "the base station", Section.OPERATION),
    ("deploy", "push HOST", "versions on a robot, images, and checks of machine and robot file", Section.OPERATION),
    ("log bundle", "", "what a maintainer needs to find a fault, in one zip", "support-bundle"),
    ("log view", "run.mcap", "plays a log in the browser: scene, plots and events of each moment", ""),
    ("log archive", "segway", "serve a robot's logs and support bundles over ROS 2", "archive"),
    ("station serve", "", "a page in the browser that shows and commands every robot on the ROS network", "supervise"),
    ("station status", "", "the robots on the ROS network and the state of each", "status"),
    ("deploy push", "HOST", "put a version onto a robot over ssh, try it, and go back if it is not healthy", ""),
    ("deploy rollback", "HOST", "take a robot back to the newest older healthy release", ""),
    ("deploy status", "HOST", "the releases on a robot, and how the last update ended", ""),
    ("deploy check", "robot.yaml", "whether a robot file loads here, with its model; no bus is opened", ""),
    ("deploy doctor", "segway", "whether this machine is fit to run the robot, and how to fix what is not", "doctor"),
    ("deploy image", "FOLDER", "build an image for the robot from Debian packages and this software", "image"),
)
_INSTALL: Final = "install the station on this machine: service, tokens, discovery, firewall"
VERBS: Final = (
    *list_verbs(__name__, _ROWS),
    Verb("station install", _INSTALL, "sudo segway-ecc station install", __name__, formerly="base-station"),
)

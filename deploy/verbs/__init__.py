# SPDX-License-Identifier: MIT
"""The verbs that put a robot into operation, one module each."""

from typing import Final

from segway_ecc.node.cli.verb import Section, Verb

_VERBS: Final = (
    ("log bundle", "", "what a maintainer needs to find a fault, in one zip", "support-bundle"),
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
"""Each with the arguments of its example, and its name in version 0.1 where that was another."""
_INSTALLED: Final = "install the station on this machine: service, tokens, discovery, firewall"
_DEPLOYED: Final = "versions on a robot, images, and checks of machine and robot file"
VERBS: Final = (
    Verb("station", "the base station", "segway-ecc station serve", None, Section.OPERATION),
    Verb("deploy", _DEPLOYED, "segway-ecc deploy push HOST", None, Section.OPERATION),
    *(
        Verb(name, summary, f"segway-ecc {name} {words}".rstrip(), __name__, formerly=formerly)
        for name, words, summary, formerly in _VERBS
    ),
    Verb("station install", _INSTALLED, "sudo segway-ecc station install", __name__, formerly="base-station"),
)

"""The verbs that put a robot into operation, one module each."""

from typing import Final

from segway_ecc.node.cli.verb import Section, Verb

VERBS: Final = (
    Verb("log bundle", "what a maintainer needs to find a fault, in one zip", "segway-ecc log bundle", __name__),
    Verb(
        "log archive", "serve a robot's logs and support bundles over ROS 2", "segway-ecc log archive segway", __name__
    ),
    Verb("station", "the base station", "segway-ecc station serve", None, Section.OPERATION),
    Verb(
        "station serve",
        "a page in the browser that shows and commands every robot on the ROS network",
        "segway-ecc station serve",
        __name__,
    ),
    Verb(
        "station status", "the robots on the ROS network and the state of each", "segway-ecc station status", __name__
    ),
    Verb(
        "station install",
        "install the station on this machine: service, tokens, discovery, firewall",
        "sudo segway-ecc station install",
        __name__,
    ),
    Verb(
        "deploy",
        "versions on a robot, images, and checks of machine and robot file",
        "segway-ecc deploy push HOST",
        None,
        Section.OPERATION,
    ),
    Verb(
        "deploy push",
        "put a version onto a robot over ssh, try it, and go back if it is not healthy",
        "segway-ecc deploy push HOST",
        __name__,
    ),
    Verb(
        "deploy rollback",
        "take a robot back to the newest older healthy release",
        "segway-ecc deploy rollback HOST",
        __name__,
    ),
    Verb(
        "deploy status",
        "the releases on a robot, and how the last update ended",
        "segway-ecc deploy status HOST",
        __name__,
    ),
    Verb(
        "deploy check",
        "whether a robot file loads here, with its model; no bus is opened",
        "segway-ecc deploy check robot.yaml",
        __name__,
    ),
    Verb(
        "deploy doctor",
        "whether this machine is fit to run the robot, and how to fix what is not",
        "segway-ecc deploy doctor segway",
        __name__,
    ),
    Verb(
        "deploy image",
        "build an image for the robot from Debian packages and this software",
        "segway-ecc deploy image --out FOLDER",
        __name__,
    ),
)

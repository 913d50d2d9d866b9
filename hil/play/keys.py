# SPDX-License-Identifier: MIT
"""The keys that drive and command a robot: one table for the terminal and for the station's page.

The page's keys.js has it too, and so has docs/base-station.md; a test compares them.
"""

from typing import Final, NamedTuple


class Binding(NamedTuple):
    """What some keys do, each of them.

    Attributes:
        act: What it is called: as a command of the station, a trial of the demo, or a way to drive.
        keys: As browsers name them (W3C UI Events); a letter is that letter.
        words: For a person.
    """

    act: str
    keys: tuple[str, ...]
    words: str


KEYS: Final = (
    Binding("ahead", ("ArrowUp", "w"), "ahead"),
    Binding("back", ("ArrowDown", "s"), "back"),
    Binding("left", ("ArrowLeft", "a"), "left"),
    Binding("right", ("ArrowRight", "d"), "right"),
    Binding("rest", ("x",), "rest"),
    Binding("stop", ("Escape", "Space"), "STOP"),
    Binding("take_control", ("t",), "take control"),
    Binding("arm", ("m",), "arm"),
    Binding("disarm", ("n",), "disarm"),
    Binding("clear_fault", ("c",), "clear fault"),
    Binding("stand", ("u",), "stand up"),
    Binding("sit", ("j",), "sit down"),
    Binding("push", ("p",), "push"),
    Binding("cut", ("b",), "cut the bus"),
    Binding("recover", ("r",), "repair"),
    Binding("quit", ("q",), "quit"),
)

# SPDX-License-Identifier: MIT
"""What the command line knows of a verb before it is used; each room lists its own in `verbs/__init__.py`."""

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

ENTRY_POINTS: Final = "segway_ecc.verbs"
"""The group of entry points by which a room, or another distribution, adds its verbs."""


@enum.unique
class Section(enum.Enum):
    """The parts of the help, in order."""

    ROBOT = "run a robot"
    MODEL = "models and design"
    OPERATION = "log, operate, deploy"
    PROOF = "prove and measure"


@dataclass(frozen=True, slots=True)
class Verb:
    """A verb, or a group of verbs where its `package` is None.

    Attributes:
        name: Its words, such as `run` or `model inspect`.
        summary: What it does, in one line.
        example: A command that works as it stands, or with the reader's own file or host.
        package: Where its module is: `run.py`, or `model_inspect.py`, with `add_arguments(parser)` and `run(options)`.
        section: Where the help lists it; that of its group where it is in one.
        formerly: Its words in version 0.1, where those were others.
    """

    name: str
    summary: str
    example: str
    package: str | None
    section: Section | None = None
    formerly: str = ""

    @property
    def module(self) -> str:
        """The module that implements it."""
        return f"{self.package}.{self.name.replace(' ', '_').replace('-', '_')}"


def list_verbs(package: str, rows: Iterable[tuple[str, str, str, Section | str]]) -> tuple[Verb, ...]:
    """The verbs of a package, where their modules are; one with others below it is a group.

    Of each, the rows give its name, the arguments of its example and its summary; then the section of one at the top,
    and of one in a group its name in version 0.1, empty where it had none or the same.
    """
    rows = tuple(rows)
    groups = {name.partition(" ")[0] for name, *_ in rows if " " in name}
    return tuple(
        Verb(name, summary, f"segway-ecc {name} {words}".rstrip(), None if name in groups else package, section, was)
        for name, words, summary, where in rows
        for section, was in [(where, "") if isinstance(where, Section) else (None, where)]
    )

# SPDX-License-Identifier: MIT
"""Named variables with units, and what a write to each one does."""

import enum
from dataclasses import dataclass


@enum.unique
class Write(enum.StrEnum):
    """When a write to a variable takes effect."""

    NOW = "now"
    """At the next step."""
    STATIC = "static"
    """At the next step, through the static equations, which the write runs again."""
    RESET = "reset"
    """When the model is initialized again."""
    NEVER = "never"
    """The variable cannot be written."""


@dataclass(frozen=True, slots=True)
class Variable:
    """One input, output, parameter or state of a model.

    Attributes:
        name: Name as the model gives it; unique within the model.
        unit: SI unit symbol, "1" for none.
        value: Start value, in `unit`.
        write: When a write takes effect.
        why: What decides that, in a few words; empty where the model's author declares it.
    """

    name: str
    unit: str = "1"
    value: float = 0.0
    write: Write = Write.NEVER
    why: str = ""

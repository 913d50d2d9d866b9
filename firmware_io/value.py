# SPDX-License-Identifier: MIT
"""What the values that pass through a cycle, and the sections of a robot file, are made of."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]


class Value(msgspec.Struct, frozen=True, gc=False):
    """Made in C and never changed; holds numbers, texts, bytes and sequences of them, so no cycle passes through it.

    The options are inherited from here, where nothing is compiled: of those of a class in a module that is, mypyc keeps
    none. `frozen=True` stands at each class again, because it is there that types are checked.
    """


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of a robot file; a key that it does not have is refused."""

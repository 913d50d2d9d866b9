# SPDX-License-Identifier: MIT
"""What a value is that passes through a cycle."""

import msgspec


class Value(msgspec.Struct, frozen=True, gc=False):
    """Made in C and never changed; holds numbers, texts, bytes and sequences of them, so no cycle passes through it.

    The options are inherited from here, where nothing is compiled: of those of a class in a module that is, mypyc keeps
    none. `frozen=True` stands at each class again, because it is there that types are checked.
    """

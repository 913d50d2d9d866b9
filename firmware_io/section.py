# SPDX-License-Identifier: MIT
"""What every part of a robot file is made of."""

import msgspec


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of a robot file; a key that it does not have is refused."""

# SPDX-License-Identifier: MIT
from collections.abc import Callable

import pytest

_GENERATOR = 0x12F
"""x^8 + x^5 + x^3 + x^2 + x + 1 with its leading term, as the catalogue of CRCs gives CRC-8H2F."""


def _remainder(data: bytes) -> int:
    # Long division of the whole message at once, so that nothing is shared with the table in the code under test.
    length = 8 * len(data)
    bits = (int.from_bytes(data, "big") << 8) ^ (0xFF << length)
    for place in reversed(range(length)):
        if bits >> (place + 8) & 1:
            bits ^= _GENERATOR << place
    return bits ^ 0xFF


@pytest.fixture(scope="session")
def reference_crc() -> Callable[[bytes], int]:
    """CRC-8H2F by polynomial division, bit by bit."""
    return _remainder

# SPDX-License-Identifier: MIT
"""How many examples a test of arbitrary input tries: as many as a quick run allows, or more where asked for."""

import os

from hypothesis import settings

EXAMPLES = int(os.environ.get("SEGWAY_ECC_EXAMPLES", "1000"))
"""`make coverage` asks for 10,000."""

fuzzed = settings(derandomize=True, deadline=None, max_examples=EXAMPLES)

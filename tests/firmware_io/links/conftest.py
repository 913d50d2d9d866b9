# SPDX-License-Identifier: MIT
import os

import pytest


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> str:
    """A channel of this test alone, also while other test runs go on at the same machine."""
    return f"{request.node.nodeid} {os.getpid()}"

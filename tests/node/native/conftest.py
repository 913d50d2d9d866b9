# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from tests.fixtures.twenty_sim.maker import Maker


@pytest.fixture(scope="session")
def make(tmp_path_factory: pytest.TempPathFactory) -> Maker:
    """Models as 20-sim writes them, in every shape."""

    def new_folder() -> Path:
        return tmp_path_factory.mktemp("model")

    return Maker(new_folder)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    # Nearly everything here compiles what it tests.
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.compiler)

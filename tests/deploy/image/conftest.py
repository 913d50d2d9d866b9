# SPDX-License-Identifier: MIT
"""One image for all tests of a run, built anew only where it has changed."""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from segway_ecc.deploy.image import disk
from segway_ecc.deploy.image.build import BuildOptions, Image, build, image_in
from segway_ecc.deploy.image.recipe import Recipe, image_cache
from tests.deploy.image.robot import SwitchOn
from tests.deploy.image.uml_machine import Machine, switched_on

KEPT_S = 12 * 3600
ROOT = Path(__file__).parents[3]
RECIPE = Recipe(kernel="none", vcan=True)
CONFIG = {
    "hostname": "robot-under-test\n",
    "environment": """RUN_OPTIONS=--interface socketcan --channel vcan0 --no-ros
GUARD_OPTIONS=--interface socketcan --channel vcan0
ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
""",
    "robot/shaker.py": '''"""Both motors ahead, always: so that it shows when they are off."""

from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel


class Shaker(SectionedModel):
    name = "shaker"
    step_size = 0.02
    method = Method.DISCRETE
    outputs = (Variable("Left", "V"), Variable("Right", "V"))

    def output(self):
        return (5.0, 5.0)
''',
    "robot.yaml": """name: shaker
model: {source: "shaker:Shaker"}
arming: at_start
hardware:
  type: wheel_board
  can: {interface: auto, channel: auto, bitrate: 500000}
  watchdog_s: 0.05
wiring: {Left: left.voltage, Right: right.voltage}
simulation: {plant: "segway_ecc.hil.plants.cart:CartPlant"}
""",
}


def _sources() -> list[Path]:
    """What goes into the image from this checkout."""
    folders = [ROOT / package for package in ("deploy", "firmware_io", "hil", "node")]
    found = [path for folder in folders for path in folder.rglob("*") if "__pycache__" not in path.parts]
    return sorted(path for path in found if path.is_file())


def _digest() -> str:
    content = hashlib.sha256(f"{RECIPE}{CONFIG}".encode())
    for path in [*_sources(), ROOT / "pyproject.toml"]:
        content.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return content.hexdigest()[:16]


@pytest.fixture(scope="session")
def image() -> Image:
    """An image with ROS, a virtual bus and the segway; in the cache, where the next run finds it."""
    folder = image_cache() / f"test-{_digest()}"
    if not (folder / "complete").exists():
        for old in image_cache().glob("test-*"):
            if old.stat().st_mtime < time.time() - KEPT_S:  # another run may be using a newer one
                shutil.rmtree(old)
        with tempfile.TemporaryDirectory() as work:
            for name, text in CONFIG.items():
                Path(work, name).parent.mkdir(exist_ok=True)
                Path(work, name).write_text(text, "utf-8")
            build(RECIPE, folder, BuildOptions(config=Path(work), uml=True), lambda _: None)
        (folder / "complete").touch()
    return image_in(folder)


@pytest.fixture
def data(image: Image, tmp_path: Path) -> Iterator[Path]:
    """A new data partition, in memory where there is room."""
    place = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else tmp_path  # noqa: S108 - a name is added
    with tempfile.TemporaryDirectory(prefix="segway-ecc-data-", dir=place) as folder:
        path = Path(folder) / "data.ext4"
        disk.copy_sparse(image.data_file_system, path)
        yield path


@pytest.fixture
def switch_on(image: Image, data: Path) -> SwitchOn:
    """Switch the machine on, with its data partition as the last time left it."""

    def switch_on(folder: Path, *options: str) -> AbstractContextManager[Machine]:
        return switched_on(image.root_file_system, data, folder, *options)

    return switch_on

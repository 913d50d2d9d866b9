"""The robot file that goes onto the robot, with the models that stand beside it."""

from collections.abc import Iterator
from pathlib import Path

from segway_ecc.deploy.release.agent.files import is_safe
from segway_ecc.deploy.release.agent.install import ROBOT_FILE
from segway_ecc.node.config import RobotFile
from segway_ecc.node.errors import ConfigurationError


def robot_files(path: Path, file: RobotFile) -> dict[str, Path]:
    """The files by their paths in the release.

    Args:
        path: Of the robot file.
        file: Its content.

    Raises:
        ConfigurationError: One has a name that is not taken.
    """
    found = {ROBOT_FILE: path}
    sources = [file.model.source, *([file.simulation.plant] if file.simulation is not None else [])]
    for source in sources:
        for place in _beside(path.parent, source):
            found[f"robot/{place.relative_to(path.parent).as_posix()}"] = place
    for name in found:
        if not is_safe(name):
            raise ConfigurationError(f"{name}: rename it; letters, digits and _.+- only, and no hidden files")
    return found


def _beside(folder: Path, source: str) -> Iterator[Path]:
    """The files of a model: a folder or file of that name, or the module that its first word names."""
    module = source.partition(":")[0].partition(".")[0]
    for place in (folder / source, folder / module, folder / f"{module}.py"):
        if place.is_file():
            yield place
        elif place.is_dir() and source and folder.resolve() in place.resolve().parents:
            yield from (at for at in sorted(place.rglob("*")) if at.is_file() and "__pycache__" not in at.parts)
        else:
            continue
        return

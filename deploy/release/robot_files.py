# SPDX-License-Identifier: MIT
"""The robot file that goes onto the robot, with the models that stand beside it."""

from collections.abc import Iterator
from pathlib import Path

from segway_ecc.deploy.release.agent.files import is_safe
from segway_ecc.deploy.release.agent.store import ROBOT_FILE
from segway_ecc.node.config import RobotFile
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.load import PythonSource


def robot_files(path: Path, file: RobotFile) -> dict[str, Path]:
    """The files by their paths in the release.

    Args:
        path: Of the robot file.
        file: Its content.

    Raises:
        ConfigurationError: One has a name that the robot does not accept, or lies elsewhere, from where none travels.
    """
    found = {ROBOT_FILE: path}
    folder = path.resolve().parent
    written = decode_yaml(path.read_text(encoding="utf-8"), RobotFile, str(path))
    for source, as_written in zip(_sources(file), _sources(written), strict=True):
        if as_written.startswith("/"):
            raise ConfigurationError(f"{path}: {as_written} is not there on the robot: write it from the file's folder")
        for place in _files(folder, source):
            found[f"robot/{place.relative_to(folder).as_posix()}"] = place
    for name in found:
        if not is_safe(name):
            raise ConfigurationError(f"{name}: rename it; letters, digits and _.+- only, and no hidden files")
    return found


def _sources(file: RobotFile) -> list[str]:
    return [file.model.source, *([file.simulation.plant] if file.simulation is not None else [])]


def _files(folder: Path, source: str) -> Iterator[Path]:
    """The files of a model that lies in a folder; none for one that is installed."""
    python = PythonSource.parse(source)
    if python is None:
        place = folder / source
        place = place if place.exists() else Path(source).resolve()
    elif python.folder is None:
        return
    else:
        place = python.folder / python.top
        place = place if place.is_dir() else place.with_name(f"{python.top}.py")
    if not source or folder not in place.resolve().parents:
        raise ConfigurationError(
            f"{place} does not lie beside the robot file and cannot be sent along: move it into {folder}"
        )
    if place.is_dir():
        yield from (at for at in sorted(place.rglob("*")) if at.is_file() and "__pycache__" not in at.parts)
    elif place.is_file():
        yield place

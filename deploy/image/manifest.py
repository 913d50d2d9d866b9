# SPDX-License-Identifier: MIT
"""What an image was made of, so that it can be made again, and what differs between two."""

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from segway_ecc.deploy.image.commands import ImageError, inside
from segway_ecc.deploy.image.recipe import Recipe

NAME: Final = "manifest.json"


def installed_packages(root: Path) -> dict[str, str]:
    """The version of each Debian package in a root file system."""
    place = "/usr/share/segway-ecc/var/lib/dpkg"  # where `tree.finish` has put /var
    lines = inside(root, ["dpkg-query", f"--admindir={place}", "-W", "-f", "${Package} ${Version}\n"]).split("\n")
    return dict(line.split(" ", 1) for line in lines if line)


def files_of(root: Path) -> dict[str, str]:
    """What each path is: type, mode, owner, and the hash of its content or where it leads."""
    found = {}
    for path in sorted(Path(folder, name) for folder, folders, files in os.walk(root) for name in (*folders, *files)):
        status = path.lstat()
        text = f"{status.st_mode:o} {status.st_uid}:{status.st_gid} {int(status.st_mtime)}"
        if path.is_symlink():
            text += f" -> {path.readlink()}"
        elif path.is_file():
            text += f" {hashlib.sha256(path.read_bytes()).hexdigest()}"
        found[path.relative_to(root).as_posix()] = text
    return found


def write(path: Path, recipe: Recipe, packages: Mapping[str, str], wheels: Mapping[str, str], root: Path) -> None:
    """Write the manifest of an image."""
    files = files_of(root)
    digest = hashlib.sha256(json.dumps(files, sort_keys=True).encode()).hexdigest()
    content = {
        "recipe": dataclasses.asdict(recipe),
        "packages": dict(packages),
        "wheels": dict(wheels),
        "digest": digest,
        "files": files,
    }
    path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", "utf-8")


def read(path: Path) -> dict[str, Any]:
    """Read a manifest.

    Raises:
        ImageError: It is none.
    """
    try:
        content = json.loads(path.read_text("utf-8"))
        recipe_of(content)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        raise ImageError(f"{path} is no manifest of an image") from None
    return dict(content)


def recipe_of(manifest: Mapping[str, Any]) -> Recipe:
    """The recipe that makes the image again: each package of the version that it has."""
    values = dict(manifest["recipe"])
    values["packages"] = tuple(f"{name}={version}" for name, version in sorted(manifest["packages"].items()))
    values["extras"] = tuple(values["extras"])
    return Recipe(**values)


def differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """What differs between two manifests: packages, wheels and files."""
    return [
        f"{kind[:-1]} {name}: {one[kind].get(name, 'missing')} / {other[kind].get(name, 'missing')}"
        for kind in ("packages", "wheels", "files")
        for name in sorted({*one[kind], *other[kind]})
        if one[kind].get(name) != other[kind].get(name)
    ]

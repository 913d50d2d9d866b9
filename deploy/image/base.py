# SPDX-License-Identifier: MIT
"""The Debian part of an image, made once and kept."""

import os
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image.commands import run
from segway_ecc.deploy.image.recipe import Recipe

_LEFT_OUT: Final = ("/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/usr/share/info/*")


def cache_folder() -> Path:
    """Where what takes long is kept (XDG base directories)."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "segway-ecc" / "image"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def base_archive(recipe: Recipe, *, refresh: bool = False) -> Path:
    """The archive of a root file system with the recipe's packages; takes minutes the first time.

    Without root mmdebstrap makes it in a user namespace of its own.

    Raises:
        ImageError: A package is not to be had, or mmdebstrap does not work here.
    """
    archive = cache_folder() / f"base-{recipe.suite}-{recipe.base_digest}.tar"
    if archive.exists() and not refresh:
        return archive
    part = archive.with_name(f".{os.getpid()}-{archive.name}")
    words = ["mmdebstrap", "--variant=minbase", f"--include={','.join(recipe.all_packages)}"]
    words += [f"--dpkgopt=path-exclude={path}" for path in _LEFT_OUT]
    words += ['--aptopt=Acquire::Languages "none"', "--aptopt=Acquire::Check-Valid-Until false"]
    try:
        run([*words, recipe.suite, str(part), recipe.mirror], env={"SOURCE_DATE_EPOCH": str(recipe.epoch)})
        part.replace(archive)
    finally:
        part.unlink(missing_ok=True)
    return archive

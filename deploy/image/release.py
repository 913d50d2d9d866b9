# SPDX-License-Identifier: MIT
"""Our release in the image: wheels, installed in a virtual environment of its own."""

import dataclasses
import datetime as dt
import os
import shutil
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc import deploy
from segway_ecc.deploy.image.commands import ImageError, inside, run
from segway_ecc.deploy.image.recipe import Recipe, cache_folder
from segway_ecc.deploy.release.agent.files import sha256_of
from segway_ecc.deploy.release.agent.install import write_environment
from segway_ecc.deploy.release.agent.store import HEALTHY, ReleaseManifest, entries_of
from segway_ecc.deploy.release.wheels import extras_text

OPT: Final = "opt/segway-ecc"
_CHECKOUT: Final = Path(deploy.__file__).parents[2]


def build_wheel(folder: Path, epoch: int) -> Path:
    """Our wheel from the checkout that this runs from.

    Raises:
        ImageError: It does not run from one, or pip fails.
    """
    if not (_CHECKOUT / "pyproject.toml").exists():
        raise ImageError("this segway-ecc is installed and no checkout: give the wheel with --wheel FILE")
    _pip(["wheel", "--no-deps", "--wheel-dir", str(folder), str(_CHECKOUT)], epoch)
    return next(folder.glob("segway_ecc-*.whl"))


def collect_wheels(wheel: Path, recipe: Recipe, python: str) -> list[Path]:
    """What our wheel needs with the recipe's extras, from the cache or the index.

    Raises:
        ImageError: Something is not to be had, or this Python is not of the version of the image's.
    """
    ours = f"{sys.version_info.major}.{sys.version_info.minor}"
    if python != ours:
        raise ImageError(f"the image's Python is {python} and this one is {ours}: run the builder with Python {python}")
    folder = cache_folder() / f"wheels-{python}-{'-'.join(sorted(recipe.extras)) or 'plain'}"
    kept = folder / ".requirements"
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        lines = archive.read(name).decode().splitlines()
    wanted = "\n".join([*sorted(recipe.extras), *(line for line in lines if line.startswith("Requires-Dist:"))])
    if not kept.exists() or kept.read_text("utf-8") != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        # Without it, a source distribution needs the package `wheel` here, which a virtual environment has not.
        what = [f"{wheel.resolve()}{extras_text(recipe.extras)}", "pip"]
        _pip(["wheel", "--use-pep517", "--wheel-dir", str(folder), *what], recipe.epoch)
        for own in folder.glob("segway_ecc-*.whl"):
            own.unlink()
        kept.write_text(wanted, "utf-8")
    return sorted(folder.glob("*.whl"))


def install_wheels(root: Path, version: str, wheels: Sequence[Path]) -> None:
    """Make the release's virtual environment, with these wheels in it, with the image's own Python."""
    place = root / OPT / "releases" / version
    held = root / "tmp" / "wheels"
    if not (place / "venv").exists():
        inside(root, ["python3", "-I", "-m", "venv", "--without-pip", f"{folder_of(version)}/venv"])
    held.mkdir(parents=True)
    for wheel in wheels:
        shutil.copyfile(wheel, held / wheel.name)
    pip = next(path for path in held.glob("pip-*.whl"))
    names = [f"/tmp/wheels/{path.name}" for path in wheels]  # noqa: S108 - in the image, where nobody else is
    words = ["install", "--no-index", "--no-deps", "--no-compile", "--quiet", "--root-user-action=ignore", *names]
    inside(root, [f"{folder_of(version)}/venv/bin/python", "-I", f"/tmp/wheels/{pip.name}/pip", *words])  # noqa: S108
    shutil.rmtree(held)


def folder_of(version: str) -> str:
    """Where a release lies in the image."""
    return f"/{OPT}/releases/{version}"


def compile_python(root: Path, *folders: str) -> None:
    """Compile Python in the image: nothing can be compiled later, and a start takes twice as long without."""
    words = ["-m", "compileall", "-q", "--invalidation-mode", "unchecked-hash", *folders]
    inside(root, ["python3", *words], env={"PYTHONHASHSEED": "0"})


def complete_release(root: Path, version: str, epoch: int) -> None:
    """Write the release's manifest, and make it the one in use."""
    folder = root / OPT / "releases" / version
    write_environment(folder, Path(folder_of(version)))
    created = dt.datetime.fromtimestamp(epoch, dt.UTC).isoformat()
    manifest = ReleaseManifest(version, version, created, "image", entries_of(folder))
    dataclasses.replace(manifest, state=HEALTHY).write(folder)
    link = root / OPT / "current"
    link.unlink(missing_ok=True)
    link.symlink_to(f"releases/{version}")


def hashes_of(wheels: Sequence[Path]) -> dict[str, str]:
    """The SHA-256 of each wheel by its file name."""
    return {path.name: sha256_of(path) for path in sorted(wheels, key=lambda path: path.name)}


def _pip(words: Sequence[str], epoch: int) -> None:
    env = {key: value for key, value in os.environ.items() if key.startswith(("PIP_", "HTTP", "http"))}
    run(
        [sys.executable, "-P", "-m", "pip", *words, "--quiet", "--disable-pip-version-check"],
        env={**env, "SOURCE_DATE_EPOCH": str(epoch), "PATH": os.environ.get("PATH", "")},
    )

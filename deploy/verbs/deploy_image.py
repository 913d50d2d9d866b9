# SPDX-License-Identifier: MIT
"""`segway-ecc deploy image FOLDER`: builds an image for the robot from Debian packages and our release."""

import argparse
import os
import shutil
import sys
from pathlib import Path
from typing import Final, TextIO

from segway_ecc.deploy.image.build import BuildOptions, build
from segway_ecc.deploy.image.recipe import KERNELS, Recipe, base_archive, differences, missing, read_manifest, recipe_of
from segway_ecc.node.cli.options import add_json, output_of, print_found
from segway_ecc.node.errors import ConfigurationError

_AS_ROOT: Final = ("--map-root-user", "--map-auto")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy image`."""
    add_json(parser)
    default = Recipe()
    option = parser.add_argument
    option("folder", type=Path, help="where the image goes: root/, root.ext4, data.ext4, manifest.json")
    option("--config", type=Path, metavar="DIR", help="configuration to begin with: robot.yaml, hostname, ...")
    option("--wheel", type=Path, metavar="FILE", help="our wheel (default: built from this checkout)")
    option("--kernel", choices=sorted(KERNELS), default=default.kernel, help=f"default: {default.kernel}")
    option("--disk", action="store_true", help="also a disk that boots, disk.img, with vmlinuz and initrd.img")
    option("--data-size", type=int, metavar="MIB", help="data partition (default: what logs and releases need)")
    option("--no-ros", action="store_true", help="without ROS 2")
    option("--extra", action="append", default=[], metavar="NAME", help="another extra of ours, such as canopen")
    option("--package", action="append", default=[], metavar="NAME", help="another Debian package")
    option("--vcan", action="store_true", help="with a virtual CAN bus, vcan0")
    option("--uml", action="store_true", help="with the kernel modules of user-mode Linux")
    option("--suite", default=default.suite, help=f"Debian release (default: {default.suite})")
    option("--mirror", default=default.mirror, metavar="URL", help=f"default: {default.mirror}")
    again = parser.add_mutually_exclusive_group()
    again.add_argument("--like", type=Path, metavar="MANIFEST", help="the same again: its packages, each version")
    again.add_argument("--compare", type=Path, metavar="MANIFEST", help="list what differs from that image")


def run(options: argparse.Namespace) -> int:
    """Build; 1 where the image differs from the one that it is compared with."""
    if options.like is not None:
        recipe = recipe_of(read_manifest(options.like))
    else:
        recipe = Recipe(
            suite=options.suite,
            mirror=options.mirror,
            packages=(*Recipe().packages, *sorted(options.package)),
            extras=(*(() if options.no_ros else ("ros",)), *sorted(options.extra)),
            kernel=options.kernel,
            vcan=options.vcan,
        )
    if os.geteuid() != 0:
        return _as_root(recipe, output_of(options))
    if options.config is not None and not options.config.is_dir():
        raise ConfigurationError(f"--config {options.config} is not a directory")
    what = BuildOptions(
        options.config, options.wheel, uml=options.uml, with_disk=options.disk, data_mib=options.data_size
    )
    image = build(recipe, options.folder, what, _show_step)
    made = read_manifest(image.manifest)
    other = options.like or options.compare
    found = differences(read_manifest(other), made) if other is not None else []
    result = {"folder": str(options.folder), "digest": made["digest"], "packages": len(made["packages"])}
    texts = {name: str(value) for name, value in result.items()} | {str(n): text for n, text in enumerate(found)}
    print_found(options, {**result, "differences": found}, texts)
    return 1 if found else 0


def _as_root(recipe: Recipe, output: TextIO) -> int:
    """The same command again in a user namespace, where this user's subordinate ids are all users of the image."""
    if missing() is None:
        _show_step("Debian packages")
        base_archive(recipe)  # before, since mmdebstrap makes a namespace of its own
    unshare = shutil.which("unshare") or "unshare"
    output.flush()
    os.dup2(output.fileno(), 1)
    os.execv(unshare, [unshare, *_AS_ROOT, "--", sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *sys.argv[1:]])  # noqa: S606 - ours


def _show_step(what: str) -> None:
    sys.stderr.write(f"segway-ecc: {what}\n")

"""The root file system as a folder: packages, our release, services, and what makes it a robot's."""

import os
import shutil
from collections.abc import Iterator, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image.commands import inside, run
from segway_ecc.deploy.image.recipe import Recipe

HELD_VAR: Final = "usr/share/segway-ecc/var"
"""What a new data partition begins with."""
_DEPLOY: Final = resources.files("segway_ecc.deploy")
_UNITS: Final = "usr/lib/systemd/system"
_ENABLED: Final = (
    "segway-ecc.target",
    "segway-ecc-node.service",
    "segway-ecc-guard.service",
    "segway-ecc-configure.service",
    "segway-ecc-hostkey.service",
    "systemd-networkd.service",
    "systemd-resolved.service",
    "ssh.service",
)
_MASKED: Final = (
    "apt-daily.timer",
    "apt-daily-upgrade.timer",
    "e2scrub_all.timer",
    "e2scrub_reap.service",
    "systemd-networkd-wait-online.service",
    "systemd-binfmt.service",
    "proc-sys-fs-binfmt_misc.automount",
)
_LEFT_BEHIND: Final = ("dev/null", "etc/resolv.conf", "etc/hostname", "etc/machine-id", "root/.bash_history")
_LEFT_IN: Final = (
    "etc/ssh/ssh_host_*",
    "var/log/*.log",
    "var/log/apt/*",
    "var/cache/ldconfig/*",
    "var/lib/apt/lists/*",
)
_UML_MODULES: Final = Path("/usr/lib/uml/modules")
_NEEDED_OF_UML: Final = ("kernel/net/can", "kernel/drivers/net/can", "kernel/fs/overlayfs", "kernel/fs/autofs")
_README: Final = """Files here are taken over into /etc at each boot: hostname, authorized_keys (of root, for ssh),
robot.yaml, environment, robot/* (models beside the robot file), network/* (for systemd-networkd).
"""


def unpack(archive: Path, root: Path) -> None:
    """Unpack a root file system; device files are left to the kernel."""
    root.mkdir(parents=True)
    run(["tar", "-C", str(root), "--numeric-owner", "--exclude=./dev/*", "-xf", str(archive)])
    (root / "dev" / "null").touch()  # for the programs that run in it while it is built


def pack(root: Path, archive: Path) -> None:
    """Pack a root file system."""
    part = archive.with_name(f".{os.getpid()}-{archive.name}")
    run(["tar", "-C", str(root), "--numeric-owner", "--sort=name", "-cf", str(part), "."])
    part.replace(archive)


def furnish(root: Path, recipe: Recipe, config: Path | None) -> None:
    """Add the services and their environment, and enable them."""
    _units(root, recipe)
    _settings(root, recipe)
    shutil.rmtree(root / "config", ignore_errors=True)
    (root / "config").mkdir()
    if config is not None:
        shutil.copytree(config, root / "config", dirs_exist_ok=True)
    (root / "config" / "README").write_text(_README, "utf-8")
    inside(root, ["systemd-sysusers"])
    enabled = [*_ENABLED, *(["segway-ecc-archive.service"] if "ros" in recipe.extras else [])]
    if (root / _UNITS / "segway-ecc-settle.service").exists():
        enabled.append("segway-ecc-settle.service")
    inside(root, ["systemctl", "--quiet", "enable", *enabled])
    inside(root, ["systemctl", "--quiet", "mask", *_MASKED])


def uml_modules(root: Path) -> None:
    """Add the kernel modules that the image needs under user-mode Linux."""
    for release in _UML_MODULES.iterdir():
        place = root / "lib" / "modules" / release.name
        for name in _NEEDED_OF_UML:
            shutil.copytree(release / name, place / name)
        for path in release.glob("modules.[bo]*"):
            shutil.copy(path, place)
        run(["depmod", "--basedir", str(root), release.name])


def finish(root: Path, epoch: int) -> None:
    """Take away what the building left, put /var where a new data partition finds it, and stamp everything."""
    for name in _LEFT_BEHIND:
        (root / name).unlink(missing_ok=True)
    for pattern in _LEFT_IN:
        for found in root.glob(pattern):
            _remove(found)
    (root / "etc" / "machine-id").touch()  # empty: made at the first boot, which is none in which units are preset
    (root / "etc" / "hostname").write_text("segway\n", "ascii")
    (root / "etc" / "resolv.conf").symlink_to("/run/systemd/resolve/stub-resolv.conf")
    held = root / HELD_VAR
    shutil.rmtree(held, ignore_errors=True)
    held.parent.mkdir(parents=True, exist_ok=True)
    (root / "var").rename(held)
    (root / "var").mkdir()
    for path in _everything(root):
        if path.lstat().st_mtime > epoch:
            os.utime(path, (epoch, epoch), follow_symlinks=False)


def _units(root: Path, recipe: Recipe) -> None:
    units = root / _UNITS
    for path in _files(_DEPLOY / "systemd"):
        name, _, kind = path.name.rpartition(".")
        if kind == "conf":  # segway-ecc.sysusers.conf goes to sysusers.d
            place = root / "usr" / "lib" / f"{name.rpartition('.')[2]}.d" / "segway-ecc.conf"
        elif kind == "preset":
            place = root / "usr" / "lib" / "systemd" / "system-preset" / "50-segway-ecc.preset"
        else:
            place = units / path.name
        _write(place, path)
    for path in _files(_DEPLOY / "network"):
        if recipe.vcan or "vcan" not in path.name:
            _write(root / "usr" / "lib" / "systemd" / "network" / path.name, path)
    for path in _files(_DEPLOY / "udev"):
        _write(root / "usr" / "lib" / "udev" / "rules.d" / path.name, path)
    settle = _DEPLOY / "release" / "segway-ecc-settle.service"
    if settle.is_file():
        _write(units / settle.name, settle)


def _settings(root: Path, recipe: Recipe) -> None:
    files = _DEPLOY / "image" / "files"
    _write(root / "usr/lib/segway-ecc/init", files / "init", 0o755)
    _write(root / "usr/lib/segway-ecc/configure", files / "segway-ecc-configure", 0o755)
    for name in ("segway-ecc-configure.service", "segway-ecc-hostkey.service"):
        _write(root / _UNITS / name, files / name)
    _write(root / "usr/lib/systemd/network/89-wired.network", files / "wired.network")
    _write(root / "usr/lib/systemd/journald.conf.d/segway-ecc.conf", files / "journald.conf")
    _write(root / "usr/lib/sysctl.d/50-segway-ecc.conf", files / "sysctl.conf")
    _write(root / "etc/ssh/sshd_config.d/segway-ecc.conf", files / "sshd.conf")
    modules = ["can-raw", *(["vcan"] if recipe.vcan else [])]
    place = root / "usr/lib/modules-load.d/segway-ecc.conf"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text("".join(f"{name}\n" for name in modules), "ascii")
    (root / "etc" / "fstab").write_text("tmpfs /tmp tmpfs nosuid,nodev 0 0\n", "ascii")
    command = root / "usr" / "bin" / "segway-ecc"
    command.unlink(missing_ok=True)
    command.symlink_to("/opt/segway-ecc/current/venv/bin/segway-ecc")


def _files(folder: Traversable) -> Sequence[Traversable]:
    return sorted((path for path in folder.iterdir() if path.is_file()), key=lambda path: path.name)


def _write(place: Path, source: Traversable, mode: int = 0o644) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(source.read_bytes())
    place.chmod(mode)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _everything(root: Path) -> Iterator[Path]:
    """Everything below a folder and itself, what is deeper first, so that stamping one leaves those above to come."""
    for folder, folders, files in os.walk(root, topdown=False):
        links = [name for name in folders if Path(folder, name).is_symlink()]
        yield from (Path(folder, name) for name in (*files, *links))
        yield Path(folder)

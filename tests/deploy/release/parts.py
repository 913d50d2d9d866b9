# SPDX-License-Identifier: MIT
"""Stand-ins: a wheel of ours, a pip, and systemctl; as small as can be, so that a push takes a moment."""

import base64
import hashlib
import zipfile
from collections.abc import Mapping
from pathlib import Path

from segway_ecc.deploy.release.agent.install import ReleaseSpec
from segway_ecc.deploy.release.requests import bundle

_MAIN = """
import sys

def main():
    if sys.argv[1] == "--version":
        print("@VERSION@")
    elif "unloadable" in open(sys.argv[-1]).read():
        sys.exit("segway-ecc: the robot file does not load")
    else:
        print('{"robot": "stand-in", "rate_hz": 200.0}')
"""
_METADATA = "Metadata-Version: 2.1\nName: segway-ecc\nVersion: {}\n"
_WHEEL = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
_ENTRY = "[console_scripts]\nsegway-ecc = stand_in:main\n"

_PIP = """
import pathlib
import sys
import zipfile

wheel = sys.argv[-1]
if "unbuildable" in wheel:
    sys.exit("ERROR: no")
site = next(pathlib.Path(sys.prefix).glob("lib/python3*/site-packages"))
zipfile.ZipFile(wheel).extractall(site)
if "+ros" in wheel:
    (site / "ros_wheels_bootstrapper").mkdir()
    (site / "ros_rclpy.libs").mkdir()
script = pathlib.Path(sys.prefix) / "bin" / "segway-ecc"
head = "#!%s -IS\\nimport sys\\nsys.path.append(%r)\\n" % (sys.executable, str(site))
script.write_text(head + "from stand_in import main\\nmain()\\n")
script.chmod(0o755)
"""

# A release whose name has `bad` in it faults once it is started, one with `slow` loops too slowly, one with `mute`
# reports no status.
SYSTEMCTL = r"""#!/bin/sh
echo "$*" >> @STATE@/calls
state() {
    printf 'LoadState=loaded\nActiveState=active\nSubState=running\nNRestarts=0\nMainPID=%s\nStatusText=%s\n' $$ "$1"
}
healthy() {
    state '{"mode": "'$1'", "reason": "told so", "rate_hz": '$2', "late": 0, "blocked_by": ["tilt: it lies"]}'
}
case "$1 $*" in
    show*segway-ecc-node.service) cat @STATE@/node ;;
    show*) echo LoadState=not-found ;;
    restart*)
        case "$(readlink @ROOT@/current)" in
            *bad*) healthy FAULT 200.0 ;;
            *slow*) healthy DISARMED 190.0 ;;
            *mute*) state "" ;;
            *refused*) echo "Job for it failed" >&2; exit 1 ;;
            *) healthy DISARMED 200.5 ;;
        esac > @STATE@/node.new
        mv @STATE@/node.new @STATE@/node ;;
esac
"""


def make_wheel(folder: Path, version: str) -> Path:
    """A wheel of our name with our command, that pip takes."""
    info = f"segway_ecc-{version}.dist-info"
    files = {
        "stand_in.py": _MAIN.replace("@VERSION@", version),
        f"{info}/METADATA": _METADATA.format(version),
        f"{info}/WHEEL": _WHEEL,
        f"{info}/entry_points.txt": _ENTRY,
    }
    record = "".join(f"{name},sha256={_digest(text)},{len(text)}\n" for name, text in files.items())
    path = folder / f"segway_ecc-{version}-py3-none-any.whl"
    _write(path, files | {f"{info}/RECORD": f"{record}{info}/RECORD,,\n"})
    return path


def make_pip(folder: Path) -> Path:
    """A pip that installs the stand-in, at once."""
    path = folder / "pip-0-py3-none-any.whl"
    _write(path, {"pip/__main__.py": _PIP})
    return path


def make_bundle(folder: Path, version: str, robot: str | None = None) -> tuple[ReleaseSpec, Mapping[str, Path]]:
    """A release of stand-ins."""
    place = folder / "made" / version
    place.mkdir(parents=True, exist_ok=True)
    wheel = make_wheel(place, version)
    files = {}
    if robot is not None:
        (place / "robot.yaml").write_text(robot)
        files["robot/robot.yaml"] = place / "robot.yaml"
    return bundle([wheel, make_pip(place)], files)


def _digest(text: str) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()


def _write(path: Path, files: dict[str, str]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(zipfile.ZipInfo(name, (2020, 2, 2, 0, 0, 0)), text)

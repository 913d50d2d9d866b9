# SPDX-License-Identifier: MIT
"""The recipe's own install commands, run by the shell with bitbake's variables filled in."""

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
UNITS = "lib/systemd/system"
# As bitbake sets them for a 64-bit machine of this release.
VARIABLES = {
    "S": str(ROOT),
    "ROS_DISTRO": "jazzy",
    "PYTHON_DIR": "python3.12",
    "baselib": "lib",
    "bindir": "/usr/bin",
    "nonarch_base_libdir": "/lib",
    "nonarch_libdir": "/usr/lib",
    "sysconfdir": "/etc",
    "systemd_system_unitdir": f"/{UNITS}",
    "systemd_unitdir": "/lib/systemd",
}


@pytest.fixture
def installed(recipes: dict[str, Any], tmp_path: Path) -> Path:
    """Where the recipe installs to, after the wheel is in."""
    recipe = recipes["segway-ecc"]
    own = {name.replace("${PN}", "PN"): value for name, value in recipe.values.items()}
    values = {**own, **VARIABLES, "D": str(tmp_path), "WORKDIR": str(recipe.path.parent / "files")}
    script = re.search(r"^do_install:append\(\) \{\n(.*?)^\}$", recipe.text, re.MULTILINE | re.DOTALL)
    assert script
    text = script[1]
    while "${" in text:
        text = re.sub(r"\$\{([\w:-]+)\}", lambda found: values[found[1]], text.replace("${PN}", "PN"))

    subprocess.run(["/bin/sh", "-euc", 'bbfatal() { echo "$@" >&2; exit 1; }\n' + text], check=True)

    return tmp_path


def test_units_run_the_command_of_the_image(installed: Path) -> None:
    started = [
        line
        for unit in sorted((installed / UNITS).glob("*.service"))
        for line in unit.read_text(encoding="utf-8").splitlines()
        if line.startswith("ExecStart=")
    ]

    assert len(started) == 4
    assert all(line.startswith("ExecStart=/usr/bin/segway-ecc ") for line in started)


def test_ros_is_found_by_services_and_shell(installed: Path) -> None:
    paths = {
        "AMENT_PREFIX_PATH=/opt/ros/jazzy",
        "LD_LIBRARY_PATH=/opt/ros/jazzy/lib",
        "PYTHONPATH=/opt/ros/jazzy/lib/python3.12/site-packages",
    }
    shell = (installed / "etc/profile.d/segway-ecc-ros.sh").read_text(encoding="utf-8")

    assert set(re.findall(r"^export (.*)$", shell, re.MULTILINE)) == paths
    for unit in ("archive", "node", "station"):
        drop_in = installed / UNITS / f"segway-ecc-{unit}.service.d" / "10-ros.conf"
        assert set(re.findall(r"^Environment=(.*)$", drop_in.read_text(encoding="utf-8"), re.MULTILINE)) == paths


def test_links_names_and_folders_are_the_products(installed: Path) -> None:
    deploy = ROOT / "deploy"
    placed = {
        "lib/systemd/network": [*deploy.glob("network/*.network"), *deploy.glob("network/*.link")],
        "lib/udev/rules.d": [*deploy.glob("udev/*.rules")],
    }

    for folder, sources in placed.items():
        assert {path.name for path in (installed / folder).iterdir()} == {path.name for path in sources}
    tmpfiles = installed / "usr/lib/tmpfiles.d/segway-ecc.conf"
    assert tmpfiles.read_bytes() == (deploy / "systemd" / "segway-ecc.tmpfiles.conf").read_bytes()

# SPDX-License-Identifier: MIT
"""What can be known of the layer without bitbake: that it is consistent with the product and with itself."""

import hashlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]

# Rules of oelint-adv that are not asked for, and why; everything else has zero findings.
SUPPRESSED = {
    "oelint.vars.homepageping": "there is no network where the tests run",
    "oelint.var.mandatoryvar.HOMEPAGE": "our own recipes have no public address",
    "oelint.var.suggestedvar.BUGTRACKER": "nobody reads it on a robot",
    "oelint.var.suggestedvar.CVE_PRODUCT": "the names at PyPI are the default already",
    "oelint.var.bbclassextend": "nothing of this is needed on the machine that builds",
}
# What the image takes from other layers.
FROM_OTHERS = {"can-utils", "iproute2", "kernel-modules"}


def _pyproject() -> Any:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def _package(requirement: str) -> str:
    """The recipe of a requirement: python3-can for python-can, python3-mcap for mcap, rclpy for ros-jazzy-rclpy."""
    name = Requirement(requirement).name
    return name.removeprefix("ros-jazzy-") if name.startswith("ros-") else f"python3-{name.removeprefix('python-')}"


def test_the_linter_finds_nothing(layer: Path) -> None:
    files = [str(path) for pattern in ("*.bb", "*.bbappend") for path in layer.rglob(pattern)]
    options = [word for rule in SUPPRESSED for word in ("--suppress", rule)]
    command = [str(Path(sys.executable).parent / "oelint-adv"), "--quiet", "--jobs", "1", "--release", "scarthgap"]

    done = subprocess.run([*command, *options, *files], capture_output=True, text=True, check=False)

    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_the_layer_is_for_scarthgap_and_names_what_it_needs(metadata: list[Any]) -> None:
    conf = next(each for each in metadata if each.path.name == "layer.conf")

    assert conf.values["LAYERSERIES_COMPAT_segway-ecc"] == "scarthgap"
    assert set(conf.words("LAYERDEPENDS_segway-ecc")) == {
        "core",
        "meta-python",
        "openembedded-layer",
        "ros-common-layer",
        "ros2-layer",
        "ros2-jazzy-layer",
    }


def test_every_local_file_exists(metadata: list[Any]) -> None:
    named = 0
    for each in metadata:
        for name in re.findall(r"file://([\w.-]+)", each.values.get("SRC_URI", "")):
            assert (each.path.parent / "files" / name).is_file(), f"{each.path.name} names {name}"
            named += 1

    assert named


def test_every_required_file_exists(layer: Path, metadata: list[Any]) -> None:
    required = [name for each in metadata for name in re.findall(r"^require (\S+)$", each.text, re.MULTILINE)]

    assert required
    assert [name for name in required if not (layer / name).is_file()] == []


def test_the_recipe_has_the_products_version_and_licence(recipes: dict[str, Any]) -> None:
    recipe = recipes["segway-ecc"]
    md5 = hashlib.md5((ROOT / "LICENSE").read_bytes(), usedforsecurity=False).hexdigest()

    assert recipe.version == _pyproject()["project"]["version"]
    assert recipe.values["LICENSE"] == _pyproject()["project"]["license"]
    assert recipe.values["LIC_FILES_CHKSUM"] == f"file://LICENSE;md5={md5}"


def test_every_dependency_is_on_the_robot(recipes: dict[str, Any]) -> None:
    project = _pyproject()["project"]
    recipe = recipes["segway-ecc"]
    wanted = {
        "RDEPENDS:${PN}": project["dependencies"],
        "RDEPENDS:${PN}-canopen": project["optional-dependencies"]["canopen"],
        "RDEPENDS:${PN}-ros": project["optional-dependencies"]["ros"],
        "RDEPENDS:${PN}-station": project["optional-dependencies"]["station"],
    }

    for variable, requirements in wanted.items():
        assert {_package(each) for each in requirements} <= set(recipe.words(variable)), variable
    assert "rmw-fastrtps-cpp" in recipe.words("RDEPENDS:${PN}-ros"), "the extra `fastrtps` of rclpy"


def test_our_recipes_are_as_new_as_the_product_asks(recipes: dict[str, Any]) -> None:
    project = _pyproject()["project"]
    asked = [Requirement(each) for each in (*project["dependencies"], *project["optional-dependencies"]["canopen"])]
    ours = {each.name: recipes[_package(str(each))] for each in asked if _package(str(each)) in recipes}

    assert set(ours) == {"canopen", "mcap", "msgspec", "python-can"}
    assert [each.name for each in asked if each.name in ours and ours[each.name].version not in each.specifier] == []


def test_sources_from_pypi_carry_checksums(recipes: dict[str, Any]) -> None:
    from_pypi = [each for each in recipes.values() if re.search(r"^inherit pypi\b", each.text, re.MULTILINE)]

    assert len(from_pypi) == 5
    for each in from_pypi:
        assert re.fullmatch(r"[0-9a-f]{64}", each.values["SRC_URI[sha256sum]"]), each.name
        assert re.search(r";md5=[0-9a-f]{32}$", each.values["LIC_FILES_CHKSUM"]), each.name


def test_the_old_back_end_can_read_the_products_metadata(recipes: dict[str, Any], tmp_path: Path) -> None:
    """The recipe rewrites three lines of pyproject.toml; they have to stand there as it expects."""
    expressions = re.findall(
        r"-e '(.*)'", recipes["segway-ecc"].text.partition("do_configure")[2].partition("}\n\n")[0]
    )
    copy = tmp_path / "pyproject.toml"
    copy.write_bytes((ROOT / "pyproject.toml").read_bytes())

    subprocess.run(["/bin/sed", "-i", *(word for each in expressions for word in ("-e", each)), copy], check=True)

    written = tomllib.loads(copy.read_text(encoding="utf-8"))
    assert written["build-system"]["requires"] == ["hatchling"]
    assert written["project"]["license"] == {"text": "MIT"}
    assert "license-files" not in written["project"]


def test_every_unit_exists_and_names_no_release_directory(recipes: dict[str, Any]) -> None:
    recipe = recipes["segway-ecc"]
    units = [*recipe.words("SYSTEMD_SERVICE:${PN}"), *recipe.words("SYSTEMD_SERVICE:${PN}-station")]

    assert set(recipe.words("SEGWAY_ECC_ROS_UNITS")) <= set(units)
    for unit in units:
        text = (ROOT / "deploy" / "systemd" / unit).read_text(encoding="utf-8")
        text = text.replace("EnvironmentFile=-/opt/segway-ecc/current/environment\n", "")  # as the recipe does
        assert "/opt/segway-ecc" not in text.replace("/opt/segway-ecc/current/venv/bin/", "/usr/bin/"), unit


@pytest.mark.parametrize(
    "pattern", ["network/*.link", "network/*.network", "systemd/segway-ecc.tmpfiles.conf", "udev/*.rules"]
)
def test_links_folders_and_serial_ports_are_described(recipes: dict[str, Any], pattern: str) -> None:
    assert f"${{S}}/deploy/{pattern} " in recipes["segway-ecc"].text
    assert list((ROOT / "deploy").glob(pattern))


def test_the_user_is_the_one_of_the_units(recipes: dict[str, Any]) -> None:
    user = (ROOT / "deploy" / "systemd" / "segway-ecc.sysusers.conf").read_text(encoding="utf-8")
    words = recipes["segway-ecc"].words("USERADD_PARAM:${PN}")

    assert (words[-1], words[words.index("--groups") + 1]) == ("segway", "dialout")
    assert words[words.index("--home-dir") + 1] == "${localstatedir}/lib/segway-ecc"
    assert user.split() == ["u", "segway", "-", '"segway-ecc"', "/var/lib/segway-ecc", "m", "segway", "dialout"]


def test_the_image_is_read_only_and_takes_what_there_is(recipes: dict[str, Any], layer: Path) -> None:
    image = recipes["segway-ecc-image"]
    ours = {name for name in recipes if name.startswith("segway-ecc")}
    ours |= {word.replace("${PN}", "segway-ecc") for word in re.findall(r"\$\{PN\}-\w+", recipes["segway-ecc"].text)}

    assert {"read-only-rootfs", "overlayfs-etc"} <= set(image.words("IMAGE_FEATURES"))
    assert set(image.words("IMAGE_INSTALL")) <= ours | FROM_OTHERS
    label = image.values["OVERLAYFS_ETC_DEVICE"].removeprefix("LABEL=")
    for variable in ("WKS_FILE:rpi", "WKS_FILE:qemux86-64"):
        assert f"--label {label} " in (layer / "wic" / image.values[variable]).read_text(encoding="utf-8")


def test_kernel_options_are_spelled_as_the_kernel_spells_them(layer: Path) -> None:
    known = "".join(path.read_text(encoding="utf-8") for path in sorted(Path("/boot").glob("config-*-rt-*")))
    if not known:
        pytest.skip("no configuration of a PREEMPT_RT kernel: apt-get install linux-image-rt-amd64")
    fragments = "".join(path.read_text(encoding="utf-8") for path in layer.rglob("*.cfg"))
    options = re.findall(r"^(CONFIG_\w+)=[ym]$", fragments, re.MULTILINE)

    assert len(options) == len(set(options)) == len([1 for line in fragments.splitlines() if line[:1] not in {"", "#"}])
    assert [each for each in options if not re.search(rf"^(# )?{each}(=| is not set)", known, re.MULTILINE)] == []
    assert {"CONFIG_PREEMPT_RT", "CONFIG_CAN_RAW", "CONFIG_CAN_VCAN", "CONFIG_CAN_GS_USB"} <= set(options)

# SPDX-License-Identifier: MIT
"""The verb on the real machine, whatever that is fit for."""

import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Probes, bad, good, warning
from segway_ecc.deploy.verbs import deploy_doctor
from segway_ecc.deploy.verbs.deploy_doctor import report as text_of
from tests.command import Outcome

SHORT_NS = 50_000_000


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Measure for a moment only, and know no robot of this machine."""
    monkeypatch.setattr(Probes.__init__, "__defaults__", (lambda _fraction: None, SHORT_NS))
    monkeypatch.setattr(deploy_doctor, "_INSTALLED_ROBOT", tmp_path / "robot.yaml")


def test_every_finding_on_this_machine_has_a_remedy(tmp_path: Path) -> None:
    """As a user calls it: the exit code follows from what it prints."""
    command = [
        sys.executable,
        "-P",
        "-m",
        "segway_ecc.node.cli.main",
        "deploy",
        "doctor",
        "cart",
        "--json",
        "--logs",
        str(tmp_path),
    ]
    ended = subprocess.run(command, capture_output=True, check=False, text=True)
    report = json.loads(ended.stdout)
    assert (report["robot"], ended.stderr) == ("cart", "")
    names = [finding["name"] for finding in report["findings"]]
    assert len(set(names)) == len(names) >= 15
    assert not [name for name in names if name.startswith("check of")]
    for finding in report["findings"]:
        assert finding.keys() == {"name", "verdict", "found", "effect", "remedy"}
        assert finding["verdict"] in {"good", "warning", "bad"}
        assert finding["found"]
        assert finding["verdict"] == "good" or (finding["effect"] and finding["remedy"])
    is_bad = any(finding["verdict"] == "bad" for finding in report["findings"])
    assert (report["fit"], ended.returncode) == (not is_bad, int(is_bad))


def test_a_robot_out_of_reach_is_not_fit(segway_ecc: Callable[..., Outcome], tmp_path: Path) -> None:
    words = ["cart-can", "--interface", "socketcan", "--channel", "nosuchcan0", "--logs", str(tmp_path)]
    ended = segway_ecc("deploy", "doctor", *words)
    assert ended.code == 1
    assert "not there; " in ended.out
    assert ended.out.splitlines()[-1].startswith("not fit to run 'cart-can': ")


def test_the_installed_robot_is_taken(
    segway_ecc: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    installed = tmp_path / "robot.yaml"
    installed.write_text(
        "name: ours\nmodel: {source: 'segway_ecc.node.models.cart:Cart'}\nwiring: {}\n", encoding="utf-8"
    )
    monkeypatch.setattr(deploy_doctor, "_INSTALLED_ROBOT", installed)
    assert json.loads(segway_ecc("deploy", "doctor", "--json", "--logs", str(tmp_path)).out)["robot"] == "ours"


def test_without_a_robot(segway_ecc: Callable[..., Outcome], tmp_path: Path) -> None:
    report = json.loads(segway_ecc("deploy", "doctor", "--json", "--logs", str(tmp_path)).out)
    assert report["robot"] is None
    assert next(f["found"] for f in report["findings"] if f["name"] == "wake-ups").startswith("at 200 Hz ")


def test_no_such_robot(segway_ecc: Callable[..., Outcome]) -> None:
    ended = segway_ecc("deploy", "doctor", "nobody")
    assert (ended.code, ended.out) == (2, "")
    assert len(ended.errors) == 1


def test_progress_is_for_a_terminal(
    segway_ecc: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(Probes.__init__, "__defaults__", (lambda _fraction: None, 400_000_000))
    segway_ecc("deploy", "doctor", "--logs", str(tmp_path))
    assert terminal.getvalue().startswith("\rsegway-ecc: measuring wake-ups, 50%")
    assert terminal.getvalue().endswith(f"\r{'':<40}\r")


def test_the_report() -> None:
    long = "ten letters " * 9
    findings = [good("disk", "empty"), warning("clock", long, "late", "sudo x"), bad("bus", "off", "none", "y")]
    assert text_of("ours", findings).splitlines() == [
        "good     disk   empty",
        f"warning  clock  {'ten letters ' * 8}ten",
        "                letters",
        "                so: late",
        "                do: sudo x",
        "bad      bus    off",
        "                so: none",
        "                do: y",
        "not fit to run 'ours': 1 bad, 1 warning, 1 good",
    ]
    assert text_of(None, findings[:2]).splitlines()[-1] == "fit to run a robot: 0 bad, 1 warning, 1 good"


BROKEN = """
import ctypes
from segway_ecc import Method, SectionedModel, Variable

class Broken(SectionedModel):
    name, step_size, method, outputs = "Broken", 0.01, Method.DISCRETE, (Variable("level"),)

    def output(self):
        {}
        return (0.0,)
{}
"""
ENDS = {
    "a crash in a step": ("ctypes.string_at(0)", "", "in its initial equations of cycle 0", "segmentation fault"),
    "a crash while loaded": ("", "ctypes.string_at(0)", "while it was loaded", "segmentation fault"),
    "an end by system call": (
        "ctypes.CDLL(None)._exit(0)",
        "",
        "in its initial equations",
        "it ended the process with",
    ),
}


@pytest.mark.variants(1)
@pytest.mark.parametrize(("in_step", "at_import", "where", "cause"), ENDS.values(), ids=ENDS)
def test_a_model_that_ends_its_process_is_one_finding_beside_all_others(
    tmp_path: Path, in_step: str, at_import: str, where: str, cause: str
) -> None:
    (tmp_path / "broken.py").write_text(BROKEN.format(in_step, at_import), encoding="utf-8")
    robot = tmp_path / "ours.yaml"
    robot.write_text("name: ours\nmodel: {source: 'broken:Broken'}\nwiring: {level: odometry.x}\n", encoding="utf-8")
    words = ["deploy", "doctor", str(robot), "--json", "--logs", str(tmp_path)]
    command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words]
    ended = subprocess.run(command, capture_output=True, check=False, text=True)
    assert ended.returncode == 1
    findings = json.loads(ended.stdout)["findings"]
    assert len(findings) >= 15
    (found,) = [finding["found"] for finding in findings if finding["name"] == "robot file: model"]
    assert where in found
    assert cause in found

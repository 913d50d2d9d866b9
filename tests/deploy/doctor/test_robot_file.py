# SPDX-License-Identifier: MIT
"""Robot files that would hurt somebody, and those that ship."""

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import msgspec
import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict, Workload
from segway_ecc.deploy.doctor.robot_file import check_robot_file, examine_robot
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.node.config import RobotFile, load_robot, packaged_robots, read_text
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.settings import SafetySettings
from tests.command import Outcome
from tests.deploy.doctor.fake_machine import FakeMachine

MODEL = """
from segway_ecc import Method, SectionedModel, Variable, Write

class Drive(SectionedModel):
    name = "drive"
    step_size = 0.01
    method = Method.DISCRETE
    inputs = (Variable("LeftSpeed", "rad/s"), Variable("RightSpeed", "rad/s"))
    outputs = (Variable("LeftVolts", "V"), Variable("RightVolts", "V"))
    parameters = (Variable("Gain", "1", 2.0, Write.STATIC), Variable("Radius", "m", 0.1, Write.STATIC),
                  Variable("Offset", "m", 0.0, Write.STATIC))

    def output(self):
        return (self.p["Gain"] / self.p["Radius"], 0.0)
"""
ROBOT = """
name: ours
model: {source: "drive:Drive"}
hardware: {type: wheel_board, imu: true, can: {interface: auto, channel: auto}}
wiring: {LeftSpeed: left.velocity, RightSpeed: right.velocity, LeftVolts: left.voltage, RightVolts: right.voltage}
"""


def found_in(file: RobotFile) -> dict[str, Finding]:
    findings = list(examine_robot(build_robot(file, RealClock())))
    names = [finding.name for finding in findings]
    assert len(set(names)) == len(names)
    return dict(zip(names, findings, strict=True))


def verdicts(file: RobotFile) -> dict[str, str]:
    return {name.removeprefix("robot file: "): str(finding.verdict) for name, finding in found_in(file).items()}


def with_parameters(robot: str, **parameters: float) -> RobotFile:
    """A packaged robot's file as somebody else wrote it, without the ranges that it gives itself."""
    file = load_robot(robot)
    model = msgspec.structs.replace(file.model, parameters={**file.model.parameters, **parameters}, ranges={})
    return msgspec.structs.replace(file, model=model)


def with_wiring(robot: str, wiring: Mapping[str, str]) -> RobotFile:
    file = load_robot(robot)
    return msgspec.structs.replace(file, wiring={**file.wiring, **wiring})


def with_safety(robot: str, safety: SafetySettings | None) -> RobotFile:
    return msgspec.structs.replace(load_robot(robot), safety=safety)


@pytest.fixture
def ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., RobotFile]:
    """A robot of a user's own model, with parameters and wiring other than its own."""
    monkeypatch.delitem(sys.modules, "drive", raising=False)
    (tmp_path / "drive.py").write_text(MODEL, encoding="utf-8")
    (tmp_path / "ours.yaml").write_text(ROBOT, encoding="utf-8")

    def make(
        parameters: Mapping[str, float],
        wiring: Mapping[str, str] | None = None,
        text: Iterable[tuple[str, str]] = (),
    ) -> RobotFile:
        for old, new in text:
            path = tmp_path / "drive.py"
            path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
        file = load_robot(str(tmp_path / "ours.yaml"))
        model = msgspec.structs.replace(file.model, parameters=dict(parameters))
        return msgspec.structs.replace(file, model=model, wiring={**file.wiring, **(wiring or {})})

    return make


@pytest.mark.parametrize("name", packaged_robots())
def test_nothing_is_wrong_with_what_ships(segway_ecc: Callable[..., Outcome], name: str) -> None:
    assert found_in(load_robot(name)) == {}
    rate = 200 if name.startswith("segway") else 100
    assert segway_ecc("deploy", "check", name) == Outcome(0, f"{name} loads, and runs at {rate} Hz\n", [])


@pytest.mark.parametrize(
    ("robot", "parameter", "value", "verdict", "found"),
    [
        ("segway", "SentGain", -0.188442, Verdict.BAD, "-0.188442, the design has 0.188442: reversed"),
        ("segway-odrive", "PitchGain", -1234.46, Verdict.BAD, "-1234.46 N m/rad, the design has -12.3446 N m/rad: 100"),
        ("segway", "PitchGain", -707.3, Verdict.BAD, "57.3 times that"),
        ("segway", "PitchGain", -150.0, Verdict.WARNING, "12.2 times that"),
        ("segway", "IntegralGain", 0.0, Verdict.WARNING, "0 N/s, the design has -0.906623 N/s: nothing"),
        ("segway", "IntegralGain", -0.05, Verdict.WARNING, "0.0551 times that"),
        ("segway", "TravelGain", -0.0667, Verdict.WARNING, "0.0175 times that"),
        ("segway", "PitchGain", -0.21546, Verdict.BAD, "0.0175 times that, and the others are not as small"),
        (
            "segway-odrive",
            "PitchRateGain",
            -0.034985,
            Verdict.BAD,
            "0.0175 times that, and the others are not as small",
        ),
        ("segway", "VelocityGain", -0.0523, Verdict.BAD, "0.0175 times that, and the others are not as small"),
        ("segway", "PitchGain", 0.0, Verdict.BAD, "0 N m/rad, the design has -12.3446 N m/rad: nothing"),
        ("segway", "PitchGain", -0.5, Verdict.WARNING, "0.0405 times that"),
        ("cart-can", "FeedbackGain", 9.4, Verdict.BAD, "100 times that"),
    ],
)
def test_a_parameter_against_its_design(robot: str, parameter: str, value: float, verdict: Verdict, found: str) -> None:
    finding = found_in(with_parameters(robot, **{parameter: value}))[f"robot file: parameters, {parameter}"]
    assert finding.verdict is verdict
    assert found in finding.found
    assert f"model.parameters.{parameter}" in finding.remedy


def test_a_gain_that_is_tuned_is_none_of_our_business() -> None:
    assert verdicts(with_parameters("segway", PitchGain=-30.0, TravelGain=-1.0, MaxSpeed=0.5)) == {}


@pytest.mark.parametrize(("left_out", "verdict"), [("HeadingGain", "warning"), ("PitchGain", "bad")])
def test_gains_that_are_left_out_are_noticed(left_out: str, verdict: str) -> None:
    file = load_robot("segway")
    parameters = {name: value for name, value in file.model.parameters.items() if name != left_out}
    file = msgspec.structs.replace(file, model=msgspec.structs.replace(file.model, parameters=parameters))
    assert verdicts(file) == {f"parameters, {left_out}": verdict}


def test_gains_of_a_far_lighter_robot_are_warned_of() -> None:
    gains = ("PitchGain", "PitchRateGain", "VelocityGain")
    design = load_robot("segway").model.parameters
    light = with_parameters("segway", **{name: design[name] / 60.0 for name in gains})
    assert verdicts(light) == {f"parameters, {name}": "warning" for name in gains}


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (
            "parameters:\n",
            "parameters:\n    WheelRadius: -0.05\n",
            "'WheelRadius' cannot be -0.05: allowed is 0.005 to 1 m",
        ),
        ("PitchGain: -12.3446", "PitchGain: 12.3446", "'PitchGain' cannot be 12.3446: allowed is "),
    ],
)
def test_what_is_out_of_its_range_does_not_even_load(
    segway_ecc: Callable[..., Outcome], tmp_path: Path, old: str, new: str, reason: str
) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(read_text("segway").replace(old, new), encoding="utf-8")
    for verb in ("check", "doctor"):
        refused = segway_ecc("deploy", verb, str(path))
        assert (refused.code, refused.out) == (3, "")
        assert reason in refused.errors[-1]


def test_a_model_that_does_not_start_is_refused_with_what_it_raised(ours: Callable[..., RobotFile]) -> None:
    finding = found_in(ours({"Radius": 0.0}))["robot file: model"]
    assert finding.verdict is Verdict.BAD
    assert "in its initial equations: ZeroDivisionError" in finding.found


@pytest.mark.parametrize(
    ("robot", "wiring", "expected"),
    [
        ("segway", {"LeftVoltage": "right.voltage", "RightVoltage": "left.voltage"}, {"LeftVoltage", "RightVoltage"}),
        ("segway", {"LeftAngle": "right.angle"}, {"LeftAngle"}),
        ("segway", {"LeftAngle": "left.velocity"}, {"LeftAngle"}),
        ("segway", {"GyroX": "imu.angular_velocity_y"}, {"GyroX"}),
        ("segway", {"GyroZ": "imu.linear_acceleration_z"}, {"GyroZ"}),
        ("cart-odrive", {"LeftVelocity": "right.velocity"}, {"LeftVelocity"}),
        ("cart-odrive", {"Heading": "odometry.angular_velocity", "AngularVelocity": "odometry.heading"},
         {"Heading", "AngularVelocity"}),
        ("segway", {"LinearSetpoint": "setpoint.angular_velocity"}, {"LinearSetpoint"}),
        ("segway", {"X": "odometry.y", "Y": "odometry.x"}, {"X", "Y"}),
        ("segway", {"LeftVelocity": "imu.angular_velocity_y"}, {"LeftVelocity"}),
        ("segway-odrive", {"LeftTorque": "topic.phase", "Phase": "left.torque"}, {"LeftTorque", "Phase"}),
    ],
)  # fmt: skip
def test_wiring_that_is_swapped_is_refused(robot: str, wiring: dict[str, str], expected: set[str]) -> None:
    assert verdicts(with_wiring(robot, wiring)) == {f"wiring, {port}": "bad" for port in expected}


@pytest.mark.parametrize("wiring", [{"X": "topic.x"}, {"Pitch": "topic.lean"}, {"LinearSetpoint": "set.speed"}])
def test_topics_and_values_to_be_set_have_names_of_the_user_s(wiring: dict[str, str]) -> None:
    file = with_wiring("segway", wiring)
    assert file.safety is not None
    limits = {name: 3.2 for name in file.safety.output_limits or {} if name in file.wiring.values()}
    safety = msgspec.structs.replace(file.safety, output_limits=limits)
    ros = msgspec.structs.replace(file.ros, pitch=None)
    assert verdicts(msgspec.structs.replace(file, safety=safety, ros=ros)) == {}


def test_a_robot_without_checks_is_warned_of_with_what_it_lacks() -> None:
    assert found_in(with_safety("segway", None))["robot file: safety"].found == "there is no section safety"
    lacking = found_in(with_safety("segway", SafetySettings()))["robot file: safety"]
    assert lacking.verdict is Verdict.WARNING
    assert lacking.found.startswith("there is no wheel_velocity_limit, velocity_consistency, ")
    assert lacking.found.endswith(
        ", tilt_limit_rad, tilt_rate_limit, yaw_consistency, checklist, runaway, gravity, posture"
    )
    assert "tilt" not in found_in(with_safety("cart-can", SafetySettings()))["robot file: safety"].found
    assert verdicts(with_safety("cart", None)) == {}, "it drives nothing"


@pytest.mark.parametrize(
    "name",
    ["late_cycles_limit", "max_command", "command_slew", "supply", "oscillation", "runaway", "gravity", "posture"],
)
def test_one_check_that_is_lacking_is_named(name: str) -> None:
    safety = load_robot("segway-odrive").safety
    assert safety is not None
    file = with_safety("segway-odrive", msgspec.structs.replace(safety, **{name: None}))
    assert found_in(file)["robot file: safety"].found == f"there is no {name}"


@pytest.mark.parametrize("key", ["yaw_consistency", "following_error", "runaway", "gravity"])
def test_checks_for_another_robot_s_lengths_are_warned_of(key: str) -> None:
    safety = load_robot("segway").safety
    other = msgspec.structs.replace(getattr(safety, key), wheel_radius=0.5)
    assert safety is not None
    file = with_safety("segway", msgspec.structs.replace(safety, **{key: other}))
    finding = found_in(file)[f"robot file: safety, {key}.wheel_radius"]
    assert (finding.verdict, finding.found) == (Verdict.WARNING, "0.5 m, the model has 0.05 m")


@pytest.mark.parametrize(
    ("name", "limit", "verdict", "found"),
    [
        ("tilt_limit_rad", 3.0, Verdict.BAD, "3 rad: at 1.57 rad any body lies on the ground"),
        ("tilt_limit_rad", 1e6, Verdict.BAD, "1e+06 rad: at 1.57 rad any body lies on the ground"),
        ("tilt_rate_limit", 80.0, Verdict.WARNING, "80 rad/s, the design has 8 rad/s: 10 times that"),
        ("wheel_velocity_limit", 1e5, Verdict.BAD, "100000 rad/s, the design has 60 rad/s: 1.67e+03 times that"),
    ],
)
def test_a_limit_that_nothing_reaches_is_found(name: str, limit: float, verdict: Verdict, found: str) -> None:
    safety = load_robot("segway").safety
    assert safety is not None
    finding = found_in(with_safety("segway", msgspec.structs.replace(safety, **{name: limit})))
    assert (finding[f"robot file: safety, {name}"].verdict, finding[f"robot file: safety, {name}"].found) == (
        verdict,
        found,
    )


def test_a_user_s_model_has_no_design_of_ours_and_is_mostly_warned_of(ours: Callable[..., RobotFile]) -> None:
    assert verdicts(ours({"Gain": 3.0, "Offset": -1.0})) == {"safety": "warning"}
    assert verdicts(ours({"Gain": -2.0}))["parameters, Gain"] == "warning"
    assert verdicts(ours({"Gain": 200.0}))["parameters, Gain"] == "warning"
    assert verdicts(ours({"Radius": -0.1}))["parameters, Radius"] == "bad"
    assert verdicts(ours({}, {"LeftSpeed": "left.angle"}))["wiring, LeftSpeed"] == "warning"
    assert verdicts(ours({}, {"LeftSpeed": "right.velocity"}))["wiring, LeftSpeed"] == "bad"


@pytest.mark.parametrize(
    ("port", "signal", "verdict"),
    [
        ('"AngularVelocity", "rad/s"', "imu.angular_velocity_z", None),
        ('"GyroY", "rad/s"', "imu.angular_velocity_y", None),
        ('"GyroY", "rad/s"', "imu.angular_velocity_z", "warning"),
        ('"gyro_y", "rad/s"', "imu.angular_velocity_z", "warning"),
        ('"GyroY", "deg/s"', "imu.angular_velocity_y", "warning"),
        ('"Forwards", "m/s²"', "imu.linear_acceleration_x", None),
        ('"Forwards", "m/s^2"', "imu.linear_acceleration_x", None),
        ('"Forwards"', "imu.linear_acceleration_x", None),
        ('"BothSpeedsLeftRight", "rad/s"', "left.velocity", None),
    ],
)
def test_names_and_units_of_a_user_s_ports(
    ours: Callable[..., RobotFile], port: str, signal: str, verdict: str | None
) -> None:
    name = port.split('"')[1]
    file = ours({}, text=(('"LeftSpeed", "rad/s"', port),))
    wiring = {name if key == "LeftSpeed" else key: value for key, value in file.wiring.items()}
    file = msgspec.structs.replace(file, wiring={**wiring, name: signal})
    assert verdicts(file).get(f"wiring, {name}") == verdict


@pytest.mark.parametrize(
    ("call", "when"), [("step(self, u)", "while running"), ("terminate(self)", "in its final equations")]
)
def test_a_model_that_fails_in_its_first_step_or_at_the_end_is_refused(
    ours: Callable[..., RobotFile], call: str, when: str
) -> None:
    fails = f"    def {call}:\n        raise ValueError('no')\n\n    def output"
    finding = found_in(ours({}, text=[("    def output", fails)]))["robot file: model"]
    assert finding.verdict is Verdict.BAD
    assert f"failed {when}: ValueError: no" in finding.found


def test_outputs_that_are_not_finite_from_the_start_are_refused(ours: Callable[..., RobotFile]) -> None:
    finding = found_in(ours({"Gain": 1e308}))["robot file: model"]
    assert (finding.verdict, finding.found) == (Verdict.BAD, "'LeftVolts' is not finite")


def test_the_verb_refuses_with_its_reason_and_2(segway_ecc: Callable[..., Outcome], tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    text = read_text("segway").replace("PitchGain: -12.3446", "PitchGain: -1500.0")
    path.write_text(text.replace("  command_slew: 1400.0\n", ""), encoding="utf-8")
    refused = segway_ecc("deploy", "check", str(path))
    assert (refused.code, refused.out) == (2, "segway must not run\n")
    bad, lacking = refused.errors
    assert bad.startswith("segway-ecc: refused: robot file: parameters, PitchGain: -1500 N m/rad, the design has ")
    assert lacking.startswith("segway-ecc: warning: robot file: safety: there is no command_slew; so: ")
    report = json.loads(segway_ecc("deploy", "check", str(path), "--json").out)
    assert report["rate_hz"] == 200.0
    assert [(finding["name"], finding["verdict"]) for finding in report["findings"]] == [
        ("robot file: parameters, PitchGain", "bad"),
        ("robot file: safety", "warning"),
    ]


def test_the_doctor_finds_the_same(fake: FakeMachine) -> None:
    def found(file: RobotFile | None) -> list[tuple[str, str]]:
        workload = Workload(fake.root, 1, file)
        return [(finding.name, str(finding.verdict)) for finding in check_robot_file(fake.machine, workload)]

    assert found(None) == []
    assert found(load_robot("segway")) == [("robot file", "good")]
    assert found(with_safety("segway", None)) == [("robot file: safety", "warning")]

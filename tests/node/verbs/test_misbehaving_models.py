# SPDX-License-Identifier: MIT
"""Whatever a model does: its name, its cycle, its last inputs and the cause are reported, and the exit code says so."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from segway_ecc.node.watchdog.output import AT_ONCE, PER_S
from tests.fixtures.noisy import noisy
from tests.fixtures.refusing import refusing
from tests.fixtures.twenty_sim.maker import Maker
from tests.patience import PATIENCE_S

CYCLE = 7
MODEL = f"""
import ctypes, math, os, pathlib, signal, sys, time
from segway_ecc import Method, SectionedModel, Variable
libc = ctypes.CDLL(None)

def kill_watchdog():
    ours = f" {{os.getpid()}} "
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            is_ours = ours in (folder / "stat").read_text().rpartition(")")[2]
            if is_ours and b"watchdog.process" in (folder / "cmdline").read_bytes():
                os.kill(int(folder.name), signal.SIGKILL)
        except OSError:
            pass

class Tank(SectionedModel):
    name, step_size, method = "Tank", 0.01, Method.DISCRETE
    inputs, outputs = (Variable("inflow", "1", 1.5),), (Variable("level"),)
    steps = -1


    def output(self):
        self.steps += 1
        return (self.misbehave() if self.steps > {CYCLE} else 0.5,)

    def misbehave(self):
        return 0.5
"""
ROBOT = """
name: tank
model: {source: "tank:Bad", step_limit_s: 0.05}
arming: at_start
wiring: {inflow: setpoint.linear_velocity, level: odometry.x}
"""
DIES = {
    "ctypes.string_at(0)": (signal.SIGSEGV, "segmentation fault"),
    "os.abort()": (signal.SIGABRT, "aborted"),
    "signal.raise_signal(signal.SIGFPE)": (signal.SIGFPE, "floating point exception"),
    "os.kill(os.getpid(), signal.SIGKILL)": (signal.SIGKILL, "its process ended without a reason (as by _exit, exec,"),
    "libc._exit(0)": (signal.SIGABRT, "it ended the process with status 0, as by _exit ("),
    "libc.syscall(ctypes.c_long({'x86_64': 231, 'aarch64': 94}[os.uname().machine]), 512)": (
        signal.SIGABRT,
        "it ended the process with status 0, as by _exit (",
    ),
    "libc.syscall(ctypes.c_long({'x86_64': 60, 'aarch64': 93}[os.uname().machine]), 0)": (
        signal.SIGABRT,
        "it did not return within 0.05 s, and its process was ended",
    ),
    "os.execv(sys.executable, [sys.executable, '-c', ''])": (
        signal.SIGABRT,
        "its process ended without a reason (as by _exit, exec, or a kill)",
    ),
}
NEVER_RETURNS = {
    "while True: pass": "an endless loop in Python",
    "libc.pause()": "native code that waits",
    "time.sleep(1000)": "Python that waits",
}
FAILS = {
    "os._exit(0)": "it called os._exit(0), which would end the process",
    "1 / 0": "ZeroDivisionError",
}


class Ended(NamedTuple):
    """How a command ended: its exit code, negative for a signal, standard output, and the lines of standard error."""

    code: int
    out: str
    errors: list[str]

    @property
    def line(self) -> str:
        """The one line of standard error that names the model."""
        (found,) = [line for line in self.errors if "Tank" in line]
        return found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "robot.yaml").write_text(ROBOT, "utf-8")
    return tmp_path


def write(folder: Path, misbehaviour: str) -> None:
    """The model whose eighth step, in cycle 7, does something."""
    body = f"class Bad(Tank):\n    def misbehave(self):\n        {misbehaviour}\n        return 0.5\n"
    (folder / "tank.py").write_text(f"{MODEL}\n{body}", "utf-8")


def call(folder: Path, *words: str, under: Sequence[str] = (), **variables: str) -> Ended:
    command = [*under, sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words]
    given = os.environ | variables
    done = subprocess.run(command, cwd=folder, env=given, check=False, capture_output=True, text=True)
    return Ended(done.returncode, done.stdout, done.stderr.splitlines())


def drive(folder: Path, misbehaviour: str, *words: str, under: Sequence[str] = ()) -> Ended:
    write(folder, misbehaviour)
    run = ("run", "robot.yaml", "--no-ros", "--log", "run.mcap", "--duration", "1")
    return call(folder, *run, *words, under=under)


def replayed(folder: Path) -> str:
    return call(folder, "log", "replay", "run.mcap").out


@pytest.mark.variants(len(DIES))
@pytest.mark.parametrize("misbehaviour", DIES)
def test_a_model_that_ends_the_process_is_reported_with_a_whole_log(folder: Path, misbehaviour: str) -> None:
    number, cause = DIES[misbehaviour]
    ended = drive(folder, misbehaviour)
    assert ended.code == -number
    assert f"model 'Tank' failed in its step of cycle {CYCLE} (last inputs: inflow 0.0): {cause}" in ended.line
    assert ended.out == ""
    (folder / "tank.py").write_text((folder / "tank.py").read_text().replace(misbehaviour, "pass"))
    assert replayed(folder).startswith(f"identical: {CYCLE} cycles")


RAW = """
#if defined(__x86_64__)
    __asm__ volatile("syscall" : : "a"(231L), "D"(0L) : "rcx", "r11", "memory");
#elif defined(__aarch64__)
    register long number __asm__("x8") = 94, status __asm__("x0") = 0;
    __asm__ volatile("svc 0" : : "r"(number), "r"(status) : "memory");
#endif
"""


def test_generated_code_that_ends_the_process_in_assembly_is_reported(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    path = noisy(
        Maker(lambda: folder), folder, "submodel", f"static int calls; if (calls++ > 20) {{ {RAW} }} return 1.0;"
    )
    wiring = "wiring: {in: setpoint.linear_velocity, out: odometry.x}"
    robot = f"name: raw\nmodel: {{source: {path}}}\narming: at_start\n{wiring}\n"
    (folder / "robot.yaml").write_text(robot, "utf-8")
    ended = call(folder, "run", "robot.yaml", "--no-ros", "--no-log", "--duration", "20")
    assert ended.code == -signal.SIGABRT
    assert "it ended the process with status 0, as by _exit" in ended.errors[-1]


def test_the_exit_of_a_program_that_a_model_starts_is_its_own(folder: Path) -> None:
    (folder / "robot.yaml").write_text(ROBOT.replace("0.05", "10"), "utf-8")
    starts = "os.system('true') == 0 and os.system('exit 3') == 3 << 8"
    ended = drive(folder, f"self.steps > {CYCLE + 1} or 1 / ({starts})")
    assert (ended.code, [line for line in ended.errors if "Tank" in line]) == (0, [])


def test_a_fork_that_comes_back_is_no_second_controller(folder: Path) -> None:
    ended = drive(folder, f"self.steps > {CYCLE + 1} or os.fork()", "--json")
    assert ended.code == 0
    assert json.loads(ended.out)["cycles"] == 100
    assert "model 'Tank' forked the process, and its fork came back from the call: only the fork was" in ended.line


@pytest.mark.parametrize(
    "leaves", ["threading.Thread(target=time.sleep, args=(1000,)).start()", "atexit.register(time.sleep, 1000)"]
)
def test_what_a_model_leaves_behind_does_not_keep_the_process(folder: Path, leaves: str) -> None:
    module, _, _ = leaves.partition(".")
    ended = drive(folder, f"self.steps > {CYCLE + 1} or __import__('{module}').{leaves.removeprefix(f'{module}.')}")
    assert ended.code == 0
    assert ended.errors[-1] == "segway-ecc: a thread, or what a model does at exit, went on for 5 s: ended"


@pytest.mark.parametrize("does", ["sys.stdout.close()", "sys.stderr.close()"])
def test_a_model_that_closes_what_is_printed_changes_nothing(folder: Path, does: str) -> None:
    ended = drive(folder, f"self.steps > {CYCLE + 1} or {does}")
    assert (ended.code, [line for line in ended.errors if "Traceback" in line]) == (0, [])


def test_an_exception_whose_text_ends_the_process_is_a_failure_of_the_model(folder: Path) -> None:
    ended = drive(folder, "raise type('Sly', (BaseException,), {'__str__': lambda self: sys.exit(0)})")
    assert ended.code == 3
    assert f"model 'Tank' failed in cycle {CYCLE} while running: Sly: it cannot be shown" in ended.errors[-1]


def test_a_model_that_has_the_process_ended_between_two_calls_is_reported(folder: Path) -> None:
    ended = drive(folder, "signal.setitimer(signal.ITIMER_REAL, 0.002)")
    assert ended.code == -signal.SIGALRM
    assert re.search("process ended .*without a reason", ended.line)  # late, it comes in the next call


def test_a_thread_that_a_model_has_started_and_that_ends_the_process_is_reported(folder: Path) -> None:
    ended = drive(folder, "__import__('threading').Thread(target=libc._exit, args=(0,)).start()")
    assert ended.code == -signal.SIGABRT
    assert "it ended the process with status 0, as by _exit" in ended.errors[-1]


def test_a_robot_whose_watchdog_is_killed_drives_on_and_ends_as_it_should(folder: Path) -> None:
    ended = drive(folder, f"self.steps > {CYCLE + 1} or kill_watchdog()", "--json")
    assert (ended.code, json.loads(ended.out)["cycles"]) == (0, 100)
    (line,) = [line for line in ended.errors if "watchdog" in line]
    assert "the watchdog of the model has ended (status -9): a model that does not return is not ended any" in line
    assert [line for line in ended.errors if "recorder" in line] == []
    assert replayed(folder).startswith("identical: 100 cycles")


def test_a_model_that_ends_the_process_without_its_watchdog_is_reported(folder: Path) -> None:
    ended = drive(folder, "kill_watchdog(); libc._exit(0)")
    assert ended.code == -signal.SIGABRT
    assert ended.line.endswith("model 'Tank' ended the process with status 0, as by _exit, with no watchdog")
    (folder / "tank.py").write_text((folder / "tank.py").read_text().replace("kill_watchdog(); libc._exit(0)", "pass"))
    assert replayed(folder).startswith(f"identical: {CYCLE} cycles")


REFUSED = (
    "a model that ends the process with status 0 gives exit code 0 here, and is reported; torque ends by guard and "
    "drives, as where the node is killed: Operation not permitted"
)


def test_a_robot_runs_where_the_kernel_does_not_ask_its_watchdog_and_reports_that(folder: Path) -> None:
    ended = drive(folder, "pass", "--json", under=refusing("EPERM"))
    assert (ended.code, json.loads(ended.out)["cycles"]) == (0, 100)
    assert [line.partition(": ")[2] for line in ended.errors if "gives exit code 0" in line] == [REFUSED]


def test_a_model_that_ends_the_process_is_reported_where_the_kernel_does_not_ask(folder: Path) -> None:
    ended = drive(folder, "libc._exit(0)", under=refusing("EPERM"))
    assert ended.code == 0
    assert f"failed in its step of cycle {CYCLE} (last inputs: inflow 0.0): its process ended without a" in ended.line


TRACERS = {
    "strace": ["strace", "--follow-forks", "--output=/dev/null"],
    "gdb": ["gdb", "-q", "-batch", "-return-child-result", "-ex", "run", "--args"],
}


@pytest.mark.debuggers
@pytest.mark.variants(1)
@pytest.mark.parametrize("tracer", TRACERS)
def test_a_robot_that_is_traced_ends_as_it_should(folder: Path, tracer: str) -> None:
    assert drive(folder, "pass", under=TRACERS[tracer]).code == 0
    assert replayed(folder).startswith("identical: 100 cycles")


@pytest.mark.debuggers
@pytest.mark.variants(1)
@pytest.mark.parametrize("tracer", TRACERS)
def test_a_model_that_ends_a_traced_process_is_reported(folder: Path, tracer: str) -> None:
    ended = drive(folder, "libc._exit(0)", under=TRACERS[tracer])
    assert ended.code != 0
    assert f"failed in its step of cycle {CYCLE} (last inputs: inflow 0.0): it ended the process with" in ended.line


def test_the_line_of_python_is_named(folder: Path) -> None:
    line = drive(folder, "while True: pass").line
    number = (folder / "tank.py").read_text().splitlines().index("        while True: pass") + 1
    assert line.endswith(f"tank.py:{number})")


@pytest.mark.variants(1)
@pytest.mark.parametrize("misbehaviour", NEVER_RETURNS, ids=NEVER_RETURNS.values())
def test_a_step_that_never_returns_is_ended(folder: Path, misbehaviour: str) -> None:
    ended = drive(folder, misbehaviour)
    assert ended.code == -signal.SIGABRT
    told = (
        f"model 'Tank' failed in its step of cycle {CYCLE} (last inputs: inflow 0.0): it did not return within 0.05 s"
    )
    assert told in ended.line
    (folder / "tank.py").write_text((folder / "tank.py").read_text().replace(misbehaviour, "pass"))
    assert replayed(folder).startswith(f"identical: {CYCLE} cycles")


@pytest.mark.parametrize("misbehaviour", FAILS)
def test_a_model_that_raises_or_would_end_python_fails(folder: Path, misbehaviour: str) -> None:
    ended = drive(folder, misbehaviour)
    assert ended.code == 3
    assert ended.errors[-2:] == ["segway-ecc: model 'Tank': last inputs: inflow 0.0", ended.errors[-1]]
    assert f"model 'Tank' failed in cycle {CYCLE} while running: " in ended.errors[-1]
    assert FAILS[misbehaviour] in ended.errors[-1]


def test_what_a_model_prints_is_limited_and_never_in_the_output(folder: Path) -> None:
    prints = 'libc.puts(b"from C"); print("from Python"); print("to stderr", file=sys.stderr)'
    ended = drive(folder, prints, "--json")
    assert ended.code == 0
    assert json.loads(ended.out)["cycles"] == 100
    printed = [line.partition("printed: ")[2] for line in ended.errors if "printed: " in line]
    assert set(printed) == {"from C", "from Python", "to stderr"}
    rest = [int(line.split()[-3]) for line in ended.errors if line.endswith("more lines")]
    assert len(printed) + sum(rest) == 3 * (100 - CYCLE)
    assert len(printed) <= AT_ONCE + 60 * PER_S


def test_the_last_lines_before_a_crash_are_shown(folder: Path) -> None:
    body = 'libc.printf(b"step %d\\n", self.steps); self.steps < 90 or ctypes.string_at(0)'
    errors = drive(folder, body).errors
    assert any(line.endswith("printed: step 90") for line in errors)


def test_a_reader_that_stops_reading_holds_up_no_cycle(folder: Path) -> None:
    write(folder, 'libc.puts(b"x" * 4000)')
    words = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "run", "robot.yaml", "--no-ros", "--no-log"]
    with subprocess.Popen([*words, "--duration", "3", "--json"], cwd=folder, stdout=-1, stderr=-1) as process:
        assert process.stdout is not None
        assert json.loads(process.stdout.read())["cycles"] > CYCLE
        assert process.wait(PATIENCE_S) == 0


def test_a_step_limit_shorter_than_a_step_is_refused(folder: Path) -> None:
    write(folder, "pass")
    (folder / "robot.yaml").write_text(ROBOT.replace("0.05", "0.005"), "utf-8")
    ended = call(folder, "run", "robot.yaml", "--no-ros", "--no-log")
    assert ended.code == 2
    assert ended.errors[-1] == ("segway-ecc: model.step_limit_s: 0.005 s is less than the model's step of 0.01 s")


REPLAY_ENDS = {
    "ctypes.string_at(0)": (128 + signal.SIGSEGV, "segmentation fault"),
    "while True: pass": (128 + signal.SIGABRT, "it did not return within 0.05 s, and its process was ended"),
    "libc._exit(0)": (128 + signal.SIGABRT, "it ended the process with status 0, as by _exit ("),
}


@pytest.mark.variants(1)
@pytest.mark.parametrize("misbehaviour", REPLAY_ENDS)
def test_a_replay_whose_model_ends_the_process_is_reported(folder: Path, misbehaviour: str) -> None:
    code, cause = REPLAY_ENDS[misbehaviour]
    assert drive(folder, "pass").code == 0
    write(folder, misbehaviour)
    ended = call(folder, "log", "replay", "run.mcap", "--json")
    assert (ended.code, ended.out) == (code, "")
    assert f"model 'Tank' failed in its step of cycle {CYCLE} (last inputs: inflow 0.0): {cause}" in ended.line


def test_a_model_that_crashes_while_a_replay_loads_it_is_reported(folder: Path) -> None:
    assert drive(folder, "pass").code == 0
    (folder / "tank.py").write_text("import ctypes; ctypes.string_at(0)", "utf-8")
    ended = call(folder, "log", "replay", "run.mcap")
    assert ended.code == 128 + signal.SIGSEGV
    assert "tank:Bad' failed while it was loaded: segmentation fault" in ended.errors[-1]


def test_what_a_model_prints_in_a_replay_is_not_in_its_output(folder: Path) -> None:
    assert drive(folder, "print('from Python')").code == 0
    ended = call(folder, "log", "replay", "run.mcap", "--json")
    assert (ended.code, json.loads(ended.out)["identical"]) == (0, True)
    # By where it comes from until its watchdog, which only reads along, has read its name.
    names = r"(Tank|.*tank:Bad)"
    assert any(re.fullmatch(rf"segway-ecc: model '{names}' printed: from Python", line) for line in ended.errors)


def simulate(folder: Path, misbehaviour: str) -> Ended:
    write(folder, misbehaviour)
    return call(folder, "model", "simulate", "tank:Bad", "--duration", "0.1", "--json")


def test_a_crash_is_reported_as_well_where_the_service_has_python_report_it(folder: Path) -> None:
    write(folder, "ctypes.string_at(0)")
    words = ("run", "robot.yaml", "--no-ros", "--no-log", "--duration", "1")
    ended = call(folder, *words, PYTHONFAULTHANDLER="1")
    assert ended.code == -signal.SIGSEGV
    assert f"failed in its step of cycle {CYCLE} (last inputs: inflow 0.0): segmentation fault" in ended.line


def test_a_simulation_that_crashes_is_reported(folder: Path) -> None:
    ended = simulate(folder, "ctypes.string_at(0)")
    assert ended.code == -signal.SIGSEGV
    assert f"model 'Tank' failed in its step of cycle {CYCLE + 1} (last inputs: inflow 1.5): segm" in ended.line


@pytest.mark.parametrize("value", ["math.nan", "math.inf"])
def test_a_simulation_whose_output_is_not_finite_has_failed(folder: Path, value: str) -> None:
    ended = simulate(folder, f"return {value}")
    assert ended.code == 3
    assert json.loads(ended.out) == {"time_s": 0.1, "outputs": {"level": None}}
    assert ended.errors == [f"segway-ecc: output 'level' of model 'Tank' is not finite: {value[5:]} at 0.08 s"]


def test_a_simulation_of_a_model_that_raises_is_one_line(folder: Path) -> None:
    ended = simulate(folder, "1 / 0")
    assert ended.code == 3
    (line,) = ended.errors
    assert "tank:Bad' failed: ZeroDivisionError: division by zero (" in line


def test_a_module_that_raises_while_it_is_imported_is_one_line(folder: Path) -> None:
    (folder / "tank.py").write_text("1 / 0", "utf-8")
    ended = call(folder, "model", "inspect", "tank:Bad")
    assert ended.code == 3
    assert ended.errors[-1].endswith("tank:Bad': ZeroDivisionError: division by zero (" + f"{folder}/tank.py:1)")


def test_a_start_value_that_is_not_a_number_is_reported_beside_valid_json(folder: Path) -> None:
    write(folder, "pass")
    with (folder / "tank.py").open("a", encoding="utf-8") as file:
        file.write("    parameters = (Variable('area', value=math.nan),)\n")
    ended = call(folder, "model", "inspect", "tank:Bad", "--json")
    assert ended.code == 3
    assert json.loads(ended.out)["parameters"][0]["value"] is None
    assert ended.line == "segway-ecc: the start value of 'area' of model 'Tank' is not a number"


def test_a_module_that_crashes_while_it_is_imported_is_reported(folder: Path) -> None:
    (folder / "tank.py").write_text("import ctypes; ctypes.string_at(0)", "utf-8")
    ended = call(folder, "model", "inspect", "tank:Bad")
    assert ended.code == -signal.SIGSEGV
    assert "tank:Bad' failed while it was loaded: segmentation fault" in ended.errors[-1]

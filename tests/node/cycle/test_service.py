# SPDX-License-Identifier: MIT
"""The node as a service: real datagram sockets, simulated time."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from segway_ecc.node.cycle.service import NotifySocket, Service, service_of, status_text
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.cycle.timing import LoopCounters
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.testing import Bench, RecordingHardware
from tests.patience import PATIENCE_S

PERIOD_NS = 10_000_000
WATCHDOG_NS = 2_000_000_000


class Manager:
    """The service manager's end."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.bind(f"\0{address[1:]}" if address.startswith("@") else address)

    def heard(self) -> list[str]:
        """Everything since the last call."""
        texts = []
        while True:
            try:
                texts.append(self._socket.recv(1 << 16).decode())
            except BlockingIOError:
                return texts

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    manager = Manager(str(tmp_path / "notify"))
    yield manager
    manager.close()


@pytest.fixture
def service(manager: Manager) -> Service:
    return Service(NotifySocket(manager.address), PERIOD_NS, WATCHDOG_NS)


def run(service: Service, cycles: int, *, lateness_ns: int = 0, skipped: int = 0) -> None:
    for _ in range(cycles):
        service.look(lateness_ns, skipped)


@pytest.mark.parametrize("address", ["path", "@segway-ecc-test-{pid}"])
def test_a_datagram_reaches_a_path_and_an_abstract_name(address: str, tmp_path: Path) -> None:
    named = address.format(pid=os.getpid()) if address.startswith("@") else str(tmp_path / address)
    manager = Manager(named)
    assert NotifySocket(named).send("READY=1")
    assert manager.heard() == ["READY=1"]
    manager.close()


@pytest.mark.parametrize("address", ["", "@", "/", "relative", "vsock:2:1"])
def test_an_address_that_is_none_is_silent(address: str) -> None:
    notify = NotifySocket(address)
    assert not notify.send("READY=1")
    assert notify.dropped == 0


@pytest.mark.parametrize("address", ["/no/such/socket", "/with\0zero", "/" + 200 * "x", "@nobody-listens-here"])
def test_an_address_where_nobody_listens_costs_a_count_only(address: str) -> None:
    notify = NotifySocket(address)
    assert not notify.send("READY=1")
    assert notify.dropped == 1


def test_a_service_manager_that_does_not_read_is_not_waited_for(manager: Manager) -> None:
    notify = NotifySocket(manager.address)
    sent = 0
    while notify.send("WATCHDOG=1"):  # would hang here if it waited
        sent += 1
    assert notify.dropped == 1
    assert manager.heard() == sent * ["WATCHDOG=1"]


def test_ready_after_a_second_of_deadlines_and_once(service: Service, manager: Manager) -> None:
    run(service, 99)
    assert "READY=1" not in manager.heard()
    run(service, 1)
    assert manager.heard().count("READY=1") == 1
    run(service, 1000)
    assert "READY=1" not in manager.heard()


def test_a_slow_loop_is_ready_after_its_first_cycle_on_time(manager: Manager) -> None:
    Service(NotifySocket(manager.address), 3_000_000_000).look(0, 0)
    assert manager.heard() == ["READY=1"]


@pytest.mark.parametrize(("late", "is_ready"), [(10, True), (11, False)])
def test_a_tenth_of_the_deadlines_may_be_missed(
    late: int, *, is_ready: bool, service: Service, manager: Manager
) -> None:
    run(service, late, lateness_ns=PERIOD_NS // 2 + 1)
    run(service, 100 - late, lateness_ns=PERIOD_NS // 2)
    assert ("READY=1" in manager.heard()) is is_ready


def test_after_a_bad_second_it_is_ready_after_a_good_one(service: Service, manager: Manager) -> None:
    run(service, 100, lateness_ns=PERIOD_NS)
    run(service, 99)
    assert "READY=1" not in manager.heard()
    run(service, 1)
    assert "READY=1" in manager.heard()


def test_lost_ready_notification_is_sent_again(tmp_path: Path) -> None:
    address = str(tmp_path / "later")
    service = Service(NotifySocket(address), PERIOD_NS)
    run(service, 150)
    manager = Manager(address)
    run(service, 50)
    assert manager.heard() == ["READY=1"]
    manager.close()


def test_skipped_deadlines_are_part_of_a_stretch(service: Service, manager: Manager) -> None:
    for skipped in range(1, 26):  # fifty deadlines, half of them skipped: a bad stretch, and over
        run(service, 1, skipped=skipped)
    run(service, 49, skipped=25)
    assert "WATCHDOG=1" not in manager.heard()
    run(service, 1, skipped=25)
    assert manager.heard() == ["WATCHDOG=1"]


def test_the_watchdog_is_fed_after_each_quarter_of_its_time_out(service: Service, manager: Manager) -> None:
    for _ in range(10):
        run(service, 49)
        assert "WATCHDOG=1" not in manager.heard()
        run(service, 1)
        assert manager.heard().count("WATCHDOG=1") == 1


def test_no_watchdog_is_fed_where_there_is_none(manager: Manager) -> None:
    run(Service(NotifySocket(manager.address), PERIOD_NS), 1000)
    assert manager.heard() == ["READY=1"]


def test_a_loop_that_is_late_does_not_feed_the_watchdog(service: Service, manager: Manager) -> None:
    run(service, 1000, lateness_ns=PERIOD_NS // 2 + 1)
    assert manager.heard() == []


def test_a_loop_that_skips_every_other_deadline_does_not_feed_the_watchdog(service: Service, manager: Manager) -> None:
    for cycle in range(1, 1001):
        service.look(0, cycle)
    assert manager.heard() == []


def test_a_loop_that_stood_still_feeds_again_only_after_a_good_stretch(service: Service, manager: Manager) -> None:
    run(service, 49)
    service.look(3_000_000_000, 300)  # it was stopped for three seconds
    assert manager.heard() == []
    run(service, 49, skipped=300)
    assert manager.heard() == []
    run(service, 1, skipped=300)
    assert manager.heard() == ["WATCHDOG=1"]


def test_a_watchdog_shorter_than_the_period_is_fed_each_cycle(manager: Manager) -> None:
    service = Service(NotifySocket(manager.address), PERIOD_NS, PERIOD_NS)
    run(service, 3)
    assert manager.heard() == 3 * ["WATCHDOG=1"]


MODE = {
    "mode": "DISARMED",
    "reason": "started",
    "check.rate": "ok: 200 Hz",
    "check.drives": "refused: left is off; switch it on",
    "check.real_time": "warning: not granted",
    "check.tilt": "refused: 0.9 rad",
}


def test_the_status_is_one_line_of_json() -> None:
    text = status_text(MODE, 199.996, 3, 2)
    assert "\n" not in text
    assert json.loads(text) == {
        "mode": "DISARMED",
        "reason": "started",
        "rate_hz": 200.0,
        "late": 3,
        "skipped": 2,
        "blocked_by": ["drives: left is off; switch it on", "tilt: 0.9 rad"],
    }


@pytest.mark.parametrize("mode", ["ARMED", "HOLD"])
def test_nothing_blocks_a_robot_that_is_armed(mode: str) -> None:
    assert json.loads(status_text(MODE | {"mode": mode}, 200.0, 0, 0))["blocked_by"] == []


@pytest.mark.parametrize("letter", ["x", "\n", "\0", "\x7f", '"', "\\", "\ud800", "\U0001f6d1"])
def test_the_status_fits_a_datagram_that_systemd_takes(letter: str) -> None:
    mode = {f"check.{n}": f"refused: {letter * 5000}" for n in range(50)}
    datagram = (
        f"STATUS={status_text(mode | {'mode': 'FAULT', 'reason': letter * 5000}, 1e6, 1 << 62, 1 << 62)}".encode()
    )
    assert len(datagram) <= 4096
    assert b"\n" not in datagram
    assert len(json.loads(datagram.removeprefix(b"STATUS="))["blocked_by"]) == 5


def test_the_rate_is_that_since_the_last_report(service: Service, manager: Manager) -> None:
    statuses = [DiagnosticStatus(Level.OK, "mode", "", MODE)]
    for cycles, skipped in ((100, 0), (150, 50), (250, 50)):
        service.report(statuses, LoopCounters(cycles=cycles, late=1, skipped=skipped))
    told = [json.loads(text.removeprefix("STATUS=")) for text in manager.heard()]
    assert [status["rate_hz"] for status in told] == [100.0, 50.0, 100.0]
    assert [status["skipped"] for status in told] == [0, 50, 50]


def test_a_report_before_the_first_cycle_has_no_rate(service: Service, manager: Manager) -> None:
    service.report([DiagnosticStatus(Level.OK, "mode", "", MODE)], LoopCounters())
    assert '"rate_hz": 0.0' in manager.heard()[0]
    service.report([], LoopCounters())
    assert manager.heard() == []


@pytest.mark.parametrize(
    ("variables", "fed"),
    [
        ({"WATCHDOG_USEC": "2000000"}, True),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}, True),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}, False),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": ""}, False),
        ({"WATCHDOG_USEC": "soon"}, False),
        ({"WATCHDOG_USEC": "0"}, False),
        ({"WATCHDOG_USEC": "-5"}, False),
        ({}, False),
    ],
)
def test_watchdog_of_another_process_is_not_fed(variables: dict[str, str], *, fed: bool, manager: Manager) -> None:
    run(service_of({"NOTIFY_SOCKET": manager.address, **variables}, PERIOD_NS), 50)
    assert manager.heard() == (["WATCHDOG=1"] if fed else [])


def test_node_that_is_no_service_sends_nothing() -> None:
    service = service_of({"WATCHDOG_USEC": "2000000"}, PERIOD_NS)
    run(service, 200)
    service.report([DiagnosticStatus(Level.OK, "mode", "", MODE)], LoopCounters(cycles=100))
    service.stopping()


class Cart(SectionedModel):
    """The least that a loop can run: a hundred cycles a second."""

    name = "cart"
    step_size = 0.01
    method = Method.DISCRETE
    outputs = (Variable("Voltage", "V"),)

    def output(self) -> Sequence[float]:
        return (1.0,)


@pytest.fixture
def bench(manager: Manager) -> Bench:
    """A robot as a service with a watchdog of two seconds."""
    hardware = RecordingHardware({"left.velocity": "rad/s"}, {"left.voltage": "V"}, (30.0,))
    bench = Bench(Cart(), hardware, {"Voltage": "left.voltage"})
    bench.loop.service = Service(NotifySocket(manager.address), bench.period_ns, WATCHDOG_NS)
    return bench


def kinds(datagrams: Sequence[str]) -> list[str]:
    return [text.partition("=")[0] for text in datagrams]


def test_loop_reports_ready_watchdog_status_and_stopping(bench: Bench, manager: Manager) -> None:
    bench.loop.run(cycles=200)
    heard = manager.heard()
    second = ["WATCHDOG", "WATCHDOG", "STATUS"]
    assert kinds(heard) == ["WATCHDOG", "WATCHDOG", "READY", "STATUS", *second, "STOPPING"]
    status = json.loads(heard[3].removeprefix("STATUS="))
    assert status == {
        "mode": "ARMED",
        "reason": "asked to arm",
        "rate_hz": 100.0,
        "late": 0,
        "skipped": 0,
        "blocked_by": [],
    }


def test_hanging_loop_feeds_no_watchdog(bench: Bench, manager: Manager) -> None:
    def hang() -> None:
        heard.extend(manager.heard())
        bench.clock.spend(30_000_000_000)
        bench.clock.events[151] = lambda: bench.loop.stop("after it")

    heard: list[str] = []
    bench.clock.events[150] = hang
    bench.loop.run()
    assert kinds(heard).count("WATCHDOG") == 3
    assert "WATCHDOG" not in kinds(manager.heard())


def test_a_loop_that_is_slower_than_its_period_neither_is_ready_nor_feeds(bench: Bench, manager: Manager) -> None:
    bench.stage.costs_ns.update(dict.fromkeys(range(1000), 15_000_000))
    bench.loop.run(cycles=1000)
    heard = kinds(manager.heard())
    assert "READY" not in heard
    assert "WATCHDOG" not in heard
    assert "STATUS" in heard
    assert heard[-1] == "STOPPING"


def test_stopping_is_reported_after_the_motors_are_off(bench: Bench, manager: Manager) -> None:
    def disarm() -> None:
        before.extend(kinds(manager.heard()))

    before: list[str] = []
    bench.hardware.disarm = disarm  # type: ignore[method-assign]
    bench.loop.run(cycles=5)
    assert "STOPPING" not in before
    assert manager.heard() == ["STOPPING=1"]


def test_a_loop_whose_manager_is_gone_runs_on(bench: Bench, manager: Manager, tmp_path: Path) -> None:
    manager.close()
    (tmp_path / "notify").unlink()
    bench.loop.run(cycles=300)
    assert bench.loop.counters.cycles == 300
    assert not bench.loop.counters.late


def test_run_notifies_the_service_manager(manager: Manager, tmp_path: Path) -> None:
    """The whole process, whose rate this machine may not reach: what is sure is that it tells how it is, and stops."""
    variables = {**os.environ, "NOTIFY_SOCKET": manager.address, "WATCHDOG_USEC": "2000000"}
    words = [
        sys.executable,
        "-P",
        "-m",
        "segway_ecc.node.cli.main",
        "run",
        "cart",
        "--no-ros",
        "--no-log",
        "--duration",
        "1.5",
    ]
    subprocess.run(words, env=variables, cwd=tmp_path, check=True, capture_output=True, timeout=PATIENCE_S)
    heard = manager.heard()
    assert heard[-1] == "STOPPING=1"
    statuses = [json.loads(text.removeprefix("STATUS=")) for text in heard if text.startswith("STATUS=")]
    assert statuses
    assert {status["mode"] for status in statuses} <= {"ARMED", "DISARMED", "HOLD"}

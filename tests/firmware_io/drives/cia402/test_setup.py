# SPDX-License-Identifier: MIT
"""Our set-up against a node of the canopen library."""

import itertools
import logging
import struct
from collections.abc import Callable
from typing import Any

import pytest
from canopen import SdoAbortedError

from segway_ecc.firmware_io.drives.cia402.limits import Identity
from segway_ecc.firmware_io.drives.cia402.network import LinkNetwork
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.drives.cia402.setup import SetUpError, set_up
from segway_ecc.firmware_io.links.link import Frame

DRIVE = Cia402WheelSettings(node_id=5, counts_per_turn=4096, max_torque=3.0)
SETTINGS = Cia402Settings(
    axes={"left": DRIVE, "right": Cia402WheelSettings(node_id=6, counts_per_turn=4096, max_torque=3.0)}
)
PLAN = (SETTINGS, DRIVE, 2_000)
MS = 1_000_000


@pytest.fixture
def network(memory: Any) -> LinkNetwork:
    return LinkNetwork(memory, memory.clock, memory.sleep_until_ns)


def test_every_object_is_what_it_was_asked_to_be(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5)
    assert set_up(network, *PLAN).rated_torque == pytest.approx(1.25)

    read = node.sdo
    assert read[0x1016][1].raw == 0x007F0032
    assert read[0x1017].raw == 20
    assert read[0x1005].raw == 0x80
    assert read[0x1006].raw == 2_000
    assert read[0x6007].raw == 2
    assert read[0x605A].raw == 0
    assert read[0x6060].raw == 10
    assert (read[0x60C2][1].raw, read[0x60C2][2].raw) == (2, -3)
    assert read[0x6040].raw == 0


def test_identity_is_read_as_far_as_there_is_one(memory: Any, network: LinkNetwork) -> None:
    memory.add(5)
    assert set_up(network, *PLAN).identity == Identity(0x2E8, 0x10, None, None)
    memory.add(6, without=frozenset({0x1018}))
    assert set_up(network, SETTINGS, SETTINGS.axes["right"], 2_000).identity == Identity(None, None, None, None)


def test_frames_of_a_stranger_among_the_answers_are_discarded_and_counted(
    memory: Any, network: LinkNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory.add(5)
    send, strange = memory.send, ("4399880011223344", "6001020300000000", "8001020302000106", "a0b0c0d0e0f00010")

    def send_beside_a_stranger(frame: Frame) -> bool:
        if frame.arbitration_id == 0x605:
            memory.arrived += [Frame(0x585, bytes.fromhex(data), memory.now_ns) for data in strange]
        answered: bool = send(frame)
        return answered

    monkeypatch.setattr(memory, "send", send_beside_a_stranger)
    assert set_up(network, *PLAN).rated_torque == pytest.approx(1.25)
    assert network.refused >= len(network.exchanges[5]) * len(strange)
    assert {exchange.request[1:4] for exchange in network.exchanges[5]} == {
        exchange.answer[1:4] for exchange in network.exchanges[5]
    }


def test_drive_with_profile_torque_only_is_refused_by_name_before_its_mode_is_touched(
    memory: Any, network: LinkNetwork
) -> None:
    node = memory.add(5)
    node.add_read_callback(lambda index, **_: 0x0C if index == 0x6502 else None)
    with pytest.raises(SetUpError, match=r"offers profile velocity \(3\), profile torque \(4\); profile torque alone"):
        set_up(network, *PLAN)
    assert node.sdo[0x6060].raw == 0


def test_refused_mode_is_named_with_those_that_the_drive_offers(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5)

    def refuse(index: int, **_: Any) -> None:
        if index == 0x6060:
            raise SdoAbortedError(0x06090030)

    node.add_write_callback(refuse)
    with pytest.raises(SetUpError) as raised:
        set_up(network, *PLAN)
    text = str(raised.value)
    assert text.startswith("it does not take mode 10, cyclic synchronous torque: it refuses it: Code 0x06090030")
    assert text.endswith("0x6502 offers profile torque (4), cyclic synchronous torque (10)")


@pytest.mark.parametrize(
    ("last_answered", "message"), [(0x6076, "6072:00 cannot be read"), (0x6502, "6060:00 cannot be written")]
)
def test_drive_that_falls_silent_at_its_mode_is_reported_as_silent(
    memory: Any, network: LinkNetwork, last_answered: int, message: str
) -> None:
    node = memory.add(5)

    def fall_silent(index: int, **_: Any) -> None:
        if index == last_answered:
            memory.peer.unsubscribe(0x605)

    node.add_read_callback(fall_silent)
    with pytest.raises(SetUpError, match=message):
        set_up(network, *PLAN)


def test_pdos_are_mapped_as_the_library_reads_them(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5)
    set_up(network, *PLAN)
    node.rpdo.read()
    node.tpdo.read()

    def mapped(pdo: Any) -> tuple[Any, ...]:
        return pdo.cob_id, pdo.trans_type, pdo.enabled, [(variable.index, variable.length) for variable in pdo.map]

    assert mapped(node.rpdo[1]) == (0x205, 255, True, [(0x6040, 16), (0x6071, 16)])
    assert mapped(node.tpdo[1]) == (0x185, 1, True, [(0x6041, 16), (0x6064, 32), (0x6077, 16)])
    assert mapped(node.tpdo[2]) == (0x285, 1, True, [(0x606C, 32)])
    assert mapped(node.tpdo[3]) == (0x385, 50, True, [(0x6079, 32)])
    assert not node.tpdo[4].enabled


@pytest.mark.parametrize(
    ("cycle_us", "syncs"), [(10_000, 10), (2_000, 50), (1_000, 100), (100, 240), (100_000, 1), (1_000_000, 1)]
)
def test_supply_is_sent_about_ten_times_a_second(memory: Any, network: LinkNetwork, cycle_us: int, syncs: int) -> None:
    node = memory.add(5)
    set_up(network, SETTINGS, DRIVE, cycle_us)
    assert node.sdo[0x1802][2].raw == syncs


def test_a_drive_without_a_voltage_of_the_supply_has_its_pdo_switched_off(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5, without=frozenset({0x6079}))
    node.add_write_callback(refuse_mapping_of(0x1A02, 0x6079))
    node.sdo[0x1802][1].raw = 0x385
    assert set_up(network, *PLAN).rated_torque == pytest.approx(1.25)
    assert node.sdo[0x1802][1].raw == 0x80000385
    assert node.sdo[0x1801][1].raw == 0x40000285


def test_a_drive_that_does_not_count_syncs_has_the_pdo_of_the_supply_switched_off(
    memory: Any, network: LinkNetwork
) -> None:
    node = memory.add(5)
    node.add_read_callback(lambda index, subindex, **_: 1 if (index, subindex) == (0x1802, 2) else None)
    assert set_up(network, *PLAN).rated_torque == pytest.approx(1.25)
    assert node.sdo[0x1802][1].raw == 0x80000385


def test_drive_silent_at_the_supply_mapping_is_reported(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5)

    def fall_silent(index: int, **_: Any) -> None:
        if index == 0x1802:
            memory.peer.unsubscribe(0x605)

    node.add_read_callback(fall_silent)
    with pytest.raises(SetUpError, match="TPDO3 cannot be mapped"):
        set_up(network, *PLAN)


def test_a_drive_that_refuses_remote_requests_keeps_doing_so(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5)
    set_up(network, *PLAN)
    assert node.sdo[0x1400][1].raw == 0x40000205
    assert node.sdo[0x1800][1].raw == 0x40000185


def test_it_begins_with_the_node_pre_operational_and_its_voltage_off(memory: Any, network: LinkNetwork) -> None:
    memory.add(5)
    set_up(network, *PLAN)
    identity = [(0x605, f"401810{part:02x}00000000") for part in range(1, 5)]
    asked = [(0, "8005"), (0x605, "4000100000000000"), *identity, (0x605, "2b40600000000000")]
    assert memory.heard()[: len(asked)] == asked


@pytest.mark.parametrize("missing", [0x605A, 0x1006, 0x1802, 0x1803])
def test_a_drive_need_not_have_everything(memory: Any, network: LinkNetwork, missing: int) -> None:
    memory.add(5, without=frozenset({missing, missing + 0x200}))
    assert set_up(network, *PLAN).rated_torque == pytest.approx(1.25)


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        (0x1000, "0x1000:00 cannot be read: Code 0x06020000"),
        (0x1016, "0x1016:01 cannot be written: Code 0x06020000"),
        (0x1017, "0x1017:00 cannot be written"),
        (0x6007, "0x6007:00 cannot be written"),
        (0x6060, "does not take mode 10, .* it refuses it: Code 0x06020000"),
        (0x6071, "RPDO1 is not mapped as asked|RPDO1 cannot be mapped"),
        (0x6076, "0x6076:00 cannot be read"),
        (0x1801, "TPDO2 cannot be mapped: Code 0x06020000"),
    ],
)
def test_drive_without_a_required_object_is_reported(
    memory: Any, network: LinkNetwork, missing: int, message: str
) -> None:
    memory.add(5, without=frozenset({missing}))
    if missing == 0x6071:
        memory.nodes[5].add_write_callback(refuse_mapping_of(0x1600, 0x6071))
    with pytest.raises(SetUpError, match=message):
        set_up(network, *PLAN)


def refuse_mapping_of(mapping: int, mapped: int) -> Callable[..., None]:
    """What has a node refuse to map an object."""

    def refuse(index: int, data: bytes, **_: Any) -> None:
        if index == mapping and struct.unpack("<L", data.ljust(4, b"\0"))[0] >> 16 == mapped:
            raise SdoAbortedError(0x06040041)

    return refuse


def answer(memory: Any, wanted: int, value: int) -> None:
    """Let a node read one of its objects as another value, whatever is written."""
    memory.nodes[5].add_read_callback(lambda index, subindex, **_: value if (index, subindex) == (wanted, 0) else None)


@pytest.mark.parametrize(
    ("index", "value", "message"),
    [
        (0x1000, 0x00020191, "names profile 401, not 402"),
        (0x1017, 0, "0x1017:00 reads 0 after 20 was written"),
        (0x6007, 0, "0x6007:00 reads 0 after 2 was written"),
        (0x605A, 2, "0x605A:00 reads 2 after 0 was written"),
        (0x6061, 8, "does not take mode 10"),
        (0x6076, 0, "0x6076 reads 0 N m"),
        (0x6076, 91, r"0x6076 reads 0\.091 N m, which a torque of 3 N m"),
        (0x1005, 0x81, "0x1005:00 reads 129"),
    ],
)
def test_what_reads_otherwise_is_refused(
    memory: Any, network: LinkNetwork, index: int, value: int, message: str
) -> None:
    node = memory.add(5)
    node._read_callbacks.clear()
    answer(memory, index, value)
    if index != 0x6061:
        answer(memory, 0x6061, 10)
    with pytest.raises(SetUpError, match=message):
        set_up(network, *PLAN)


@pytest.mark.parametrize("found", [0x00000000, 0x007F0033, 0x007F0013, 0x007E0032, 0x007F0000])
def test_a_watchdog_that_is_off_too_long_or_of_another_node_is_refused(
    memory: Any, network: LinkNetwork, found: int
) -> None:
    node = memory.add(5)
    node.add_read_callback(lambda index, subindex, **_: found if (index, subindex) == (0x1016, 1) else None)
    with pytest.raises(SetUpError, match=rf"0x1016:01 is set to {found & 0xFFFF} ms for node {found >> 16}"):
        set_up(network, *PLAN)


def test_a_mapping_that_is_not_kept_is_refused(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5)
    node.add_read_callback(lambda index, subindex, **_: 254 if (index, subindex) == (0x1800, 2) else None)
    with pytest.raises(SetUpError, match="TPDO1 is not mapped as asked"):
        set_up(network, *PLAN)


def test_absent_node_is_reported_after_a_third_of_a_second(memory: Any, network: LinkNetwork) -> None:
    before_ns = memory.now_ns
    with pytest.raises(SetUpError, match="0x1000:00 cannot be read: no answer"):
        set_up(network, *PLAN)
    assert memory.now_ns - before_ns == 300 * MS
    assert set(memory.waited) == {MS}


def test_full_link_fails_the_set_up(memory: Any, network: LinkNetwork) -> None:
    memory.add(5)
    memory.is_full = True
    with pytest.raises(SetUpError, match="memory does not take frames"):
        set_up(network, *PLAN)


def test_foreign_and_damaged_frames_meanwhile_change_nothing(memory: Any, network: LinkNetwork) -> None:
    memory.add(5)
    for frame in (
        Frame(0x585, b"\x43"),
        Frame(0x085, b"\x01"),
        Frame(0x705, b""),
        Frame(0x705, b"\x33"),
        Frame(0x586, bytes(8)),
        Frame(0x585, bytes(8), is_extended=True),
        Frame(0x7E5, bytes(8)),
    ):
        memory.arrived.append(frame)
    assert set_up(network, *PLAN).rated_torque == pytest.approx(1.25)
    assert network.boots[5] == 0


def test_every_answered_request_is_kept_with_its_last_answer(memory: Any, network: LinkNetwork) -> None:
    node = memory.add(5)
    node._read_callbacks.clear()
    modes = iter((0, 0, 10))
    node.add_read_callback(lambda index, **_: next(modes) if index == 0x6061 else None)
    set_up(network, *PLAN)

    asked = [frame.data for frame in memory.sent if frame.arbitration_id == 0x605]
    assert asked.count(bytes.fromhex("4061600000000000")) == 3
    kept = [exchange.request for exchange in network.exchanges[5]]
    assert kept == [request for request, _ in itertools.groupby(asked)]
    (mode,) = (e.answer for e in network.exchanges[5] if e.request == bytes.fromhex("4061600000000000"))
    assert mode == bytes.fromhex("4f6160000a000000")


def test_the_library_logs_nothing_of_its_own(
    memory: Any, network: LinkNetwork, caplog: pytest.LogCaptureFixture
) -> None:
    memory.add(5)
    with caplog.at_level(logging.DEBUG):
        set_up(network, *PLAN)
        memory.peer.unsubscribe(0x605)
        with pytest.raises(SetUpError):
            set_up(network, *PLAN)
    assert caplog.records == []

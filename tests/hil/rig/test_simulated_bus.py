# SPDX-License-Identifier: MIT
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from segway_ecc.firmware_io.links.link import Frame, Link, worst_case_bits
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

BIT_NS = 2_000
"""At 500 kbit/s."""


class Wire:
    """A bus with three participants on a clock moved by hand."""

    def __init__(self, bitrate: int = 500_000) -> None:
        self.now_ns = 0
        self.bus = SimulatedBus(bitrate, lambda: self.now_ns)
        self.a: Link = self.bus.attach("a")
        self.b: Link = self.bus.attach("b")
        self.c: Link = self.bus.attach("c")

    def heard(self, at_ns: int) -> list[tuple[int, int]]:
        """What c has heard by a time, since it was last asked: identifier, end of the frame."""
        self.now_ns = at_ns
        return [(frame.arbitration_id, frame.received_ns) for frame in self.c.receive()]


@pytest.fixture
def wire() -> Wire:
    return Wire()


@pytest.mark.parametrize(
    ("frame", "bits"),
    [
        (Frame(1, b""), 55),
        (Frame(1, bytes(1)), 65),
        (Frame(1, bytes(8)), 135),
        (Frame(1, b"", is_extended=True), 80),
        (Frame(1, bytes(8), is_extended=True), 160),
    ],
)
def test_frames_are_as_long_as_in_the_analysis(frame: Frame, bits: int) -> None:
    """Davis et al. 2007: 55 and 135 bits for 0 and 8 bytes at 11-bit identifiers, 80 and 160 at 29-bit ones."""
    assert worst_case_bits(len(frame.data), is_extended=frame.is_extended) == bits


@pytest.mark.parametrize(("bitrate", "end_ns"), [(1_000_000, 135_000), (500_000, 270_000), (125_000, 1_080_000)])
def test_a_frame_arrives_when_its_last_bit_has_passed(bitrate: int, end_ns: int) -> None:
    wire = Wire(bitrate)
    wire.a.send(Frame(0x120, bytes(8)))
    assert wire.heard(end_ns - 1) == []
    assert wire.heard(end_ns) == [(0x120, end_ns)]
    assert wire.heard(end_ns) == []


def test_a_frame_arrives_as_it_was_sent(wire: Wire) -> None:
    sent = Frame(0x1ABCDEF0, b"abc", is_extended=True)
    wire.a.send(sent)
    wire.now_ns = 110 * BIT_NS
    assert wire.b.receive() == [replace(sent, received_ns=110 * BIT_NS)]


def test_everybody_but_the_sender_receives_a_frame(wire: Wire) -> None:
    wire.a.send(Frame(1, b""))
    wire.now_ns = 55 * BIT_NS
    assert [len(link.receive()) for link in (wire.a, wire.b, wire.c)] == [0, 1, 1]
    counts = [(link.counters.sent, link.counters.received) for link in (wire.a, wire.b, wire.c)]
    assert counts == [(1, 0), (0, 1), (0, 1)]


def test_of_frames_that_wait_together_the_lowest_identifier_goes_first_whoever_sent_it(wire: Wire) -> None:
    for link, identifier in ((wire.a, 0x130), (wire.a, 0x110), (wire.b, 0x120)):
        link.send(Frame(identifier, b""))
    assert [identifier for identifier, _ in wire.heard(10**6)] == [0x110, 0x120, 0x130]


def test_equal_identifiers_keep_their_order(wire: Wire) -> None:
    for number in range(5):
        wire.a.send(Frame(7, bytes((number,))))
    wire.now_ns = 10**6
    assert [frame.data[0] for frame in wire.c.receive()] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("lower", "higher"),
    [
        (Frame(0x123, b""), Frame(0x123 << 18, b"", is_extended=True)),
        (Frame((0x123 << 18) | 0x3FFFF, b"", is_extended=True), Frame(0x124, b"")),
        (Frame((0x123 << 18) | 1, b"", is_extended=True), Frame((0x123 << 18) | 2, b"", is_extended=True)),
        (Frame(0x7FF, b""), Frame(0x1FFFFFFF, b"", is_extended=True)),
    ],
    ids=["standard before extended", "leading bits first", "trailing bits last", "the last of all"],
)
def test_arbitration_goes_bit_by_bit(wire: Wire, lower: Frame, higher: Frame) -> None:
    wire.a.send(higher)
    wire.b.send(lower)
    assert [identifier for identifier, _ in wire.heard(10**6)] == [lower.arbitration_id, higher.arbitration_id]


def test_frames_follow_each_other_without_a_gap(wire: Wire) -> None:
    wire.a.send(Frame(2, bytes(8)))
    wire.b.send(Frame(1, b""))
    assert wire.heard(10**6) == [(1, 55 * BIT_NS), (2, (55 + 135) * BIT_NS)]


def test_a_frame_on_the_wire_is_not_interrupted_by_a_lower_identifier(wire: Wire) -> None:
    wire.a.send(Frame(9, bytes(8)))
    wire.now_ns = 1
    wire.b.send(Frame(5, b""))
    wire.b.send(Frame(1, b""))
    assert wire.heard(10**6) == [(9, 135 * BIT_NS), (1, 190 * BIT_NS), (5, 245 * BIT_NS)]


def test_a_frame_that_comes_the_moment_the_wire_is_free_takes_part_in_arbitration(wire: Wire) -> None:
    wire.a.send(Frame(9, b""))
    wire.a.send(Frame(8, b""))
    wire.now_ns = 55 * BIT_NS
    wire.b.send(Frame(1, b""))
    assert [identifier for identifier, _ in wire.heard(10**6)] == [8, 1, 9]


def test_an_idle_wire_takes_a_frame_at_once(wire: Wire) -> None:
    wire.a.send(Frame(1, b""))
    wire.heard(10**6)
    wire.a.send(Frame(2, b""))
    assert wire.heard(2 * 10**6) == [(2, 10**6 + 55 * BIT_NS)]


def test_asking_often_or_seldom_makes_no_difference() -> None:
    def play(times_ns: range) -> list[tuple[int, int]]:
        wire = Wire()
        heard = []
        sending = {0: (9, 3), 150_000: (1, 7), 160_000: (2, 2), 400_000: (4, 4)}
        for now_ns in times_ns:
            heard += wire.heard(now_ns)
            for identifier in sending.get(now_ns, ()):
                wire.a.send(Frame(identifier, bytes(8)))
        return heard

    often, seldom = play(range(0, 5_000_000, 1_000)), play(range(0, 5_000_000, 10_000))
    assert often == seldom
    assert len(often) == 8


def test_opening_and_closing_forget_what_was_not_taken(wire: Wire) -> None:
    for forget in (wire.c.open, wire.c.close):
        wire.a.send(Frame(1, b""))
        wire.now_ns += 10**6
        wire.bus.deliver()
        forget()
        assert wire.c.receive() == []


def test_participants_describe_themselves(wire: Wire) -> None:
    assert wire.a.description == "simulated bus, a"


SENT = st.tuples(
    st.integers(0, 600_000),
    st.sampled_from("abc"),
    st.sampled_from((0x100, 0x101, 0x7FF)),
    st.integers(0, 8),
    st.booleans(),
)
"""After what time (ns), by whom, with which leading bits and how many bytes, and whether it is an extended frame."""


@given(st.lists(SENT, max_size=20), st.integers(100_000, 900_000))
def test_the_wire_goes_to_whom_the_rules_give_it(sent: list[tuple[int, str, int, int, bool]], look_ns: int) -> None:
    """Against the rules played out one frame at a time with all of them known beforehand."""
    wire, at_ns, frames = Wire(), 0, []
    for place, (after_ns, sender, leading, length, is_extended) in enumerate(sent):
        at_ns += after_ns
        identifier = leading << 18 | place if is_extended else leading
        frames.append((at_ns, sender, Frame(identifier, bytes((place,)) * length, is_extended=is_extended)))
    expected, free_ns, left = [], 0, list(frames)
    while left:
        start_ns = max(free_ns, left[0][0])
        winner = min((f for f in left if f[0] <= start_ns), key=lambda f: _bits(f[2]))
        left.remove(winner)
        free_ns = start_ns + worst_case_bits(len(winner[2].data), is_extended=winner[2].is_extended) * BIT_NS
        if winner[1] != "c":
            expected.append(replace(winner[2], received_ns=free_ns))
    heard: list[Frame] = []
    end_ns = free_ns + look_ns
    for now_ns in sorted({at for at, _, _ in frames} | set(range(0, end_ns + look_ns, look_ns))):
        wire.now_ns = now_ns
        heard += wire.c.receive()
        for at, sender, frame in frames:
            if at == now_ns:
                getattr(wire, sender).send(frame)
    assert heard == expected


def _bits(frame: Frame) -> str:
    """What goes over the wire until arbitration is over, a dominant 0 winning (ISO 11898-1)."""
    if frame.is_extended:
        return f"{frame.arbitration_id >> 18:011b}11{frame.arbitration_id & 0x3FFFF:018b}"
    return f"{frame.arbitration_id:011b}00"

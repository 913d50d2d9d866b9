# SPDX-License-Identifier: MIT
from segway_ecc.deploy.station.fleet import EventLog


def test_the_ring_keeps_the_newest_and_the_numbers_go_on() -> None:
    log = EventLog(lambda: 7, capacity=3)
    for index in range(5):
        log.add("/a", f"event {index}")
    assert [(event.number, event.text) for event in log.after(0)] == [(3, "event 2"), (4, "event 3"), (5, "event 4")]
    assert [event.number for event in log.after(4)] == [5]
    assert not log.after(5)
    assert not log.after(99)
    assert log.after(4)[0].wall_ns == 7


def test_a_long_text_of_the_network_is_cut() -> None:
    log = EventLog(lambda: 0)
    log.add("", "x" * 501, level="error", who="ann")
    log.add("", "y" * 500)
    cut, whole = log.after(0)
    assert len(cut.text) == 500
    assert cut.text.endswith("x...")
    assert (cut.level, cut.who) == ("error", "ann")
    assert whole.text == "y" * 500

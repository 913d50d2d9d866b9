# SPDX-License-Identifier: MIT
"""One table of keys: in the terminal, on the station's page and in the documentation."""

import json
import re
from collections import Counter
from pathlib import Path

from segway_ecc.deploy.station.views import Act
from segway_ecc.hil.demo.trials import RECOVER, trials_for
from segway_ecc.hil.play.channel import ACTS, Key, keys_in
from segway_ecc.hil.play.keys import KEYS

ROOT = Path(__file__).parents[3]
DRIVING = {"ahead", "back", "left", "right", "rest"}
MARKS = {"ArrowUp": "↑", "ArrowDown": "↓", "ArrowLeft": "←", "ArrowRight": "→", "Escape": "Esc"}


def test_the_page_has_the_same_table() -> None:
    text = (ROOT / "deploy" / "station" / "page" / "keys.js").read_text(encoding="utf-8")
    table = re.search(r"^export const KEYS = (\[\n.*?\n\]);$", text, re.DOTALL | re.MULTILINE)
    assert table is not None
    rows = json.loads(table[1].replace("],\n]", "]\n]"))
    assert rows == [[act, list(keys), words] for act, keys, words in KEYS]


def test_the_documentation_has_the_same_table() -> None:
    text = (ROOT / "docs" / "base-station.md").read_text(encoding="utf-8")
    section = text.partition("## Keys\n")[2].partition("\n## ")[0]
    found = re.findall(r"^\| ([^|]+) \| ([^|,:;]+?)(?:[,:;] [^|]*)? \|$", section, re.MULTILINE)
    expected = [(", ".join(MARKS.get(key, key.title()) for key in keys), words) for _, keys, words in KEYS]
    assert [row for row in found if row[0] not in {"Key", "---"}] == expected


def test_no_key_does_two_things() -> None:
    assert max(Counter(key for binding in KEYS for key in binding.keys).values()) == 1


def test_every_act_is_something_that_can_be_done() -> None:
    trials = {trial.view.name for trial in trials_for(["PushForce", "Payload", "Slope"], ["imu.pitch", "left.angle"])}
    assert {binding.act for binding in KEYS} <= DRIVING | set(Act) | trials | {RECOVER, "quit"}


def test_the_terminal_takes_every_key_of_what_it_can_do() -> None:
    assert ACTS - {Key.ALIVE} <= {binding.act for binding in KEYS}
    letters = {key: act for act, keys, _ in KEYS for key in keys if len(key) == 1 and act in ACTS}
    assert {key: [found.value for found in keys_in(key.encode())] for key in letters} == {
        key: [act] for key, act in letters.items()
    }
    assert (keys_in(b" "), keys_in(b"\x1b"), keys_in(b"\x1b[A")) == ([Key.STOP], [Key.STOP], [Key.UP])

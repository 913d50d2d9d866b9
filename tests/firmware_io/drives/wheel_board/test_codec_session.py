# SPDX-License-Identifier: MIT
"""The C code that takes commands of version 2, compiled, against the Python that the simulated board runs."""

import random
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from segway_ecc.firmware_io.drives.wheel_board.codec import generate
from segway_ecc.firmware_io.drives.wheel_board.frames import BoardSetup, WheelCommand
from segway_ecc.firmware_io.drives.wheel_board.session import CommandReceiver, CommandSession, code_of
from segway_ecc.firmware_io.integrity import Refusal
from segway_ecc.firmware_io.links.link import Frame

NUMBER = 0xFEDCBA98
VERDICTS = ["taken", Refusal.LENGTH, Refusal.CRC, Refusal.COUNTER, Refusal.RANGE, "half"]
HARNESS = """
    #include <stdio.h>
    #include "wheel_board_protection.h"
    int main(int count, char **words)
    {
        struct wheel_board_session_t session = {0};
        struct wheel_board_line_t line = {0};
        unsigned id, length, byte, n;
        if (count != 3 || sscanf(words[1], "%u", &session.number) != 1) return 1;
        if (sscanf(words[2], "%u", &session.counter) != 1) return 1;
        while (scanf("%u %u", &id, &length) == 2) {
            uint8_t data[16] = {0};
            struct wheel_board_command_t command = {0};
            enum wheel_board_verdict verdict;
            for (n = 0; n < length; n++) {
                if (scanf("%2x", &byte) != 1) return 1;
                data[n] = (uint8_t)byte;
            }
            verdict = wheel_board_take((uint16_t)id, data, length, &session, &line, &command);
            if (verdict != WHEEL_BOARD_TAKEN || id != 0x114) command = (struct wheel_board_command_t){0};
            printf("%d %u", (int)verdict, session.counter);
            printf(" %d %d %d\\n", command.left_mv, command.right_mv, command.enable);
        }
        return 0;
    }
"""


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The C code as an author gets it, compiled without a warning."""
    folder = tmp_path_factory.mktemp("codec")
    generate(folder)
    (folder / "main.c").write_text(HARNESS, encoding="utf-8")
    options = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-o", "firmware"]
    subprocess.run(["gcc", *options, "main.c", "wheel_board_protection.c"], cwd=folder, check=True)  # noqa: S607 - the compiler of the path
    return folder / "firmware"


def _by_c(firmware: Path, counter: int, frames: Sequence[Frame]) -> list[tuple[str, int, int, int, bool]]:
    lines = [f"{frame.arbitration_id} {len(frame.data)} {frame.data.hex()}" for frame in frames]
    command = [str(firmware), str(NUMBER), str(counter)]
    done = subprocess.run(command, input="\n".join(lines), capture_output=True, text=True, check=True)
    rows = [[int(word) for word in line.split()] for line in done.stdout.splitlines()]
    return [(VERDICTS[verdict], now, left, right, bool(on)) for verdict, now, left, right, on in rows]


def _by_us(counter: int, frames: Sequence[Frame]) -> list[tuple[str, int, int, int, bool]]:
    session = CommandSession()
    session.begin(NUMBER)
    session.counter = counter
    receiver = CommandReceiver(session)
    found = []
    for frame in frames:
        before = receiver.refused.copy()
        payload = receiver.check(frame)
        cause = next(iter(receiver.refused - before), None)
        verdict = str(cause) if cause is not None else "half" if payload is None else "taken"
        left, right, enable = 0, 0, False
        if isinstance(payload, WheelCommand):
            left, right = round(payload.left_voltage * 1e3), round(payload.right_voltage * 1e3)
            enable = payload.enable
        found.append((verdict, session.counter, left, right, enable))
    return found


def _mixed(counter: int) -> list[Frame]:
    """What a bus may bring: commands and setups, with losses, in disorder, played again, damaged, or made up."""
    dice = random.Random(counter)  # noqa: S311 - the same frames every time are wanted
    host = CommandSession()
    host.begin(NUMBER)
    host.counter = counter
    frames: list[Frame] = []
    for _ in range(1_500):
        if dice.random() < 0.05:
            host.counter = (host.counter + dice.randrange(20)) % (1 << 32)
            frames.append(host.setup(BoardSetup(dice.uniform(0.02, 1.0))))
        volts = [dice.uniform(-30.0, 30.0) for _ in range(2)]
        frames += host.command(WheelCommand(volts[0], volts[1], dice.random() < 0.5))
        if dice.random() < 0.5:
            frames[-3:] = dice.sample(frames[-3:], len(frames[-3:]))
        if dice.random() < 0.3:
            frames.append(dice.choice(frames[-40:]))
        if dice.random() < 0.3:
            frames.append(Frame(dice.choice((0x112, 0x113, 0x114)), dice.randbytes(dice.choice((7, 8, 8, 8, 9)))))
        if dice.random() < 0.3:
            damaged = int.from_bytes(frames[-1].data, "big") ^ 1 << dice.randrange(32)
            frames.insert(-1, Frame(frames[-1].arbitration_id, damaged.to_bytes(len(frames[-1].data), "big")))
        if dice.random() < 0.1:
            frames.pop(dice.randrange(max(len(frames) - 4, 0), len(frames)))
        if host.counter % 20 == 0:  # a voltage beyond 30 V, otherwise as it should be
            word = (host.counter + 1) & 0x7FFF
            body = b"\x00\x80" + word.to_bytes(2, "little")
            code = code_of(NUMBER, (host.counter + 1) % (1 << 32), 0x113, body)
            frames.append(Frame(0x113, body + code.to_bytes(4, "little")))
    return frames


@pytest.mark.compiler
@pytest.mark.parametrize("counter", [0, 0x7FF0, 0xFFFFFC00])
def test_c_takes_and_refuses_what_we_do(firmware: Path, counter: int) -> None:
    frames = _mixed(counter)
    ours = _by_us(counter, frames)
    assert _by_c(firmware, counter, frames) == ours
    assert {verdict for verdict, *_ in ours} == set(map(str, VERDICTS))
    assert sum(verdict == "taken" for verdict, *_ in ours) > 500

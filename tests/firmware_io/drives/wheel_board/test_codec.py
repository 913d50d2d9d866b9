# SPDX-License-Identifier: MIT
"""The C code that firmware authors are given, compiled, against the Python that the robot runs."""

import itertools
import random
import re
import runpy
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import cantools
import pytest
from msgspec.structs import astuple

from segway_ecc.firmware_io.drives.wheel_board import codec
from segway_ecc.firmware_io.drives.wheel_board.codec import CodecError, generate, main
from segway_ecc.firmware_io.drives.wheel_board.frames import (
    AngularVelocity,
    BoardSession,
    BoardSetup,
    BoardState,
    BoardStatus,
    FrameId,
    LinearAcceleration,
    Payload,
    Wheel,
    WheelCommand,
    decode,
    encode,
)
from segway_ecc.firmware_io.integrity import CounterCheck

NAMES = ["wheel_board.c", "wheel_board.h", "wheel_board_protection.c", "wheel_board_protection.h"]
NUMBERS_ONLY: Mapping[FrameId, Callable[..., Payload]] = {
    FrameId.BOARD_SETUP: BoardSetup,
    FrameId.LEFT_WHEEL: Wheel,
    FrameId.RIGHT_WHEEL: Wheel,
    FrameId.IMU_GYRO: AngularVelocity,
    FrameId.IMU_ACCELERATION: LinearAcceleration,
}
TAKEN, LENGTH, CRC, COUNTER = range(4)
ROUNDS = 200

with as_file(files("segway_ecc.firmware_io.drives.wheel_board") / "wheel_board.dbc") as _path:
    DBC: Any = cantools.database.load_file(_path)


def _snake(name: str) -> str:
    return re.sub(r"(?<!^)(?<!_)(?=[A-Z][a-z])", "_", name).lower()


def _signals(frame_id: FrameId) -> list[Any]:
    """The signals of a frame in the DBC's order, without counter and CRC."""
    return [s for s in DBC.get_message_by_frame_id(frame_id).signals if s.name not in {"Counter", "Crc"}]


def _harness() -> str:
    """A program that packs and checks what it is told on its standard input, a line each."""
    pack, check = [], []
    for place, frame_id in enumerate(FrameId):
        name, signals = f"wheel_board_{frame_id.name.lower()}", [_snake(s.name) for s in _signals(frame_id)]
        declare = f"case {place}: {{ struct {name}_t m;"
        encoded = "".join(f" m.{s} = {name}_{s}_encode(v[{n}]);" for n, s in enumerate(signals))
        pack.append(f"{declare} (void){name}_init(&m);{encoded} return {name}_pack(data, &m, 8); }}")
        in_range = " && ".join(f"{name}_{s}_is_in_range(m.{s})" for s in signals)
        values = "".join(f' printf(" %.17g", {name}_{s}_decode(m.{s}));' for s in signals)
        check.append(f'{declare} {name}_unpack(&m, data, 8); printf(" %d", {in_range});{values} break; }}')
    ids = ", ".join(f"WHEEL_BOARD_{frame_id.name}_FRAME_ID" for frame_id in FrameId)
    return f"""
        #include <stdio.h>
        #include <string.h>
        #include "wheel_board.h"
        #include "wheel_board_protection.h"
        static const uint16_t ids[] = {{{ids}}};
        static uint8_t counters[{len(FrameId)}];
        static struct wheel_board_sequence_t sequences[{len(FrameId)}];
        static int pack(int which, uint8_t *data, const double *v)
        {{ switch (which) {{ {" ".join(pack)} default: return -1; }} }}
        static void tell(int which, const uint8_t *data)
        {{ switch (which) {{ {" ".join(check)} default: break; }} }}
        int main(void)
        {{
            char verb[8];
            int which;
            while (scanf("%7s %d", verb, &which) == 2) {{
                uint8_t data[16] = {{0}};
                unsigned length = 8, byte, n;
                if (strcmp(verb, "pack") == 0) {{
                    double v[4] = {{0}};
                    unsigned count;
                    if (scanf("%u", &count) != 1) return 1;
                    for (n = 0; n < count; n++) if (scanf("%lf", &v[n]) != 1) return 1;
                    if (pack(which, data, v) != 8) return 1;
                    wheel_board_protect(ids[which], &counters[which], data);
                    for (n = 0; n < 8; n++) printf("%02x", data[n]);
                }} else {{
                    enum wheel_board_verdict verdict;
                    if (scanf("%u", &length) != 1) return 1;
                    for (n = 0; n < length; n++) {{
                        if (scanf("%2x", &byte) != 1) return 1;
                        data[n] = (uint8_t)byte;
                    }}
                    verdict = wheel_board_check(ids[which], data, length, &sequences[which]);
                    printf("%d %u", (int)verdict, (unsigned)sequences[which].lost);
                    if (verdict == WHEEL_BOARD_TAKEN) tell(which, data);
                }}
                printf("\\n");
            }}
            return 0;
        }}
    """


class Told(NamedTuple):
    """What C says of a frame."""

    verdict: int
    lost: int
    in_range: bool
    values: Sequence[float]


class Firmware:
    """The compiled C code."""

    def __init__(self, program: Path) -> None:
        self._program = program

    def pack(self, frames: Iterable[tuple[FrameId, Sequence[float]]]) -> list[bytes]:
        """What C makes of values."""
        places = list(FrameId)
        lines = [f"pack {places.index(i)} {len(v)} {' '.join(map(repr, map(float, v)))}" for i, v in frames]
        return [bytes.fromhex(line) for line in self._ask(lines)]

    def check(self, frames: Iterable[tuple[FrameId, bytes]]) -> list[Told]:
        """What C takes of frames, and their values where it does."""
        places = list(FrameId)
        lines = [f"check {places.index(i)} {len(data)} {data.hex()}" for i, data in frames]
        told = [line.split() for line in self._ask(lines)]
        return [Told(int(w[0]), int(w[1]), w[2:3] == ["1"], [float(value) for value in w[3:]]) for w in told]

    def _ask(self, lines: list[str]) -> list[str]:
        done = subprocess.run([self._program], input="\n".join(lines), capture_output=True, text=True, check=True)
        assert len(done.stdout.splitlines()) == len(lines)
        return done.stdout.splitlines()


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Firmware:
    """The C code as an author gets it, compiled without a warning."""
    folder = tmp_path_factory.mktemp("codec")
    generate(folder)
    (folder / "main.c").write_text(_harness(), encoding="utf-8")
    sources = ["main.c", "wheel_board.c", "wheel_board_protection.c"]
    options = ["-std=c11", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-o", "firmware"]
    subprocess.run(["gcc", *options, *sources, "-lm"], cwd=folder, check=True)  # noqa: S607 - the compiler of the path
    return Firmware(folder / "firmware")


def _payload(frame_id: FrameId, values: Sequence[float]) -> Payload:
    match frame_id:
        case FrameId.WHEEL_COMMAND:
            return WheelCommand(values[0], values[1], enable=bool(values[2]))
        case FrameId.BOARD_STATUS:
            return BoardStatus(BoardState(int(values[0])), values[1], values[2], int(values[3]))
        case FrameId.BOARD_SESSION:
            return BoardSession(int(values[0]), int(values[1]))
        case _:
            return NUMBERS_ONLY[frame_id](*values)


def _drawn() -> list[tuple[FrameId, list[float]]]:
    """Values for every frame in turn: both ends of every range, then seeded ones in it."""
    dice = random.Random(20261120)  # noqa: S311 - the same values every time are wanted
    drawn: list[tuple[FrameId, list[float]]] = []
    for frame_id in FrameId:
        signals = _signals(frame_id)
        drawn += [(frame_id, list(ends)) for ends in itertools.product(*((s.minimum, s.maximum) for s in signals))]
    for _ in range(ROUNDS):
        for frame_id in FrameId:
            values = [
                dice.randint(s.minimum, s.maximum) if s.scale == 1 else dice.uniform(s.minimum, s.maximum)
                for s in _signals(frame_id)
            ]
            drawn.append((frame_id, values))
    return drawn


DRAWN = _drawn()


def _ours(drawn: Iterable[tuple[FrameId, Sequence[float]]]) -> list[tuple[FrameId, bytes]]:
    """The frames as the robot encodes them, with running counters."""
    counters = {frame_id: itertools.count() for frame_id in FrameId}
    return [(i, encode(i, _payload(i, values), next(counters[i]))) for i, values in drawn]


@pytest.mark.compiler
def test_c_packs_every_message_as_we_do(firmware: Firmware) -> None:
    assert firmware.pack(DRAWN) == [data for _, data in _ours(DRAWN)]


@pytest.mark.compiler
def test_what_c_packs_we_take(firmware: Firmware) -> None:
    checks = {frame_id: CounterCheck() for frame_id in FrameId}
    for (frame_id, values), data in zip(DRAWN, firmware.pack(DRAWN), strict=True):
        payload, counter = decode(frame_id, data)
        steps = [signal.scale for signal in _signals(frame_id)]
        assert all(abs(a - b) <= 0.500001 * s for a, b, s in zip(astuple(payload), values, steps, strict=True))
        assert checks[frame_id].accepts(counter)
    assert [check.lost for check in checks.values()] == [0] * len(FrameId)


@pytest.mark.compiler
def test_what_we_send_c_takes_with_the_same_values(firmware: Firmware) -> None:
    frames = _ours(DRAWN)
    for (frame_id, data), told in zip(frames, firmware.check(frames), strict=True):
        assert (told.verdict, told.lost, told.in_range) == (TAKEN, 0, True)
        assert told.values == pytest.approx([float(value) for value in astuple(decode(frame_id, data)[0])], rel=1e-15)


@pytest.mark.compiler
def test_c_refuses_every_flipped_bit_and_then_takes_the_frame(firmware: Firmware) -> None:
    frames = []
    for frame_id, data in _ours(DRAWN[-len(FrameId) :]):
        whole = int.from_bytes(data, "big")
        frames += [(frame_id, (whole ^ 1 << bit).to_bytes(8, "big")) for bit in range(64)]
        frames.append((frame_id, data))
    verdicts = [told.verdict for told in firmware.check(frames)]
    assert verdicts == ([CRC] * 64 + [TAKEN]) * len(FrameId)


@pytest.mark.compiler
def test_c_refuses_a_frame_under_another_identifier(firmware: Firmware) -> None:
    frames = [(other, data) for i, data in _ours(DRAWN[-len(FrameId) :]) for other in FrameId if other is not i]
    assert {told.verdict for told in firmware.check(frames)} == {CRC}


@pytest.mark.compiler
def test_c_refuses_every_other_length(firmware: Firmware) -> None:
    frame_id, data = _ours(DRAWN)[0]
    frames = [(frame_id, (data + b"\0")[:length]) for length in (*range(8), 9)]
    assert {told.verdict for told in firmware.check(frames)} == {LENGTH}


@pytest.mark.compiler
@pytest.mark.parametrize(
    ("counters", "verdicts", "lost"),
    [
        ([3, 4, 5], [TAKEN, TAKEN, TAKEN], 0),
        ([14, 15, 0], [TAKEN, TAKEN, TAKEN], 0),
        ([3, 3, 4], [TAKEN, COUNTER, TAKEN], 0),
        ([3, 9, 10], [TAKEN, TAKEN, TAKEN], 5),
        ([3, 10, 11], [TAKEN, COUNTER, TAKEN], 0),
        ([3, 2, 3], [TAKEN, COUNTER, TAKEN], 0),
    ],
    ids=["in turn", "wrapping", "repeated", "five lost", "six lost", "back"],
)
def test_c_follows_the_counter(firmware: Firmware, counters: Sequence[int], verdicts: Sequence[int], lost: int) -> None:
    frame_id = FrameId.WHEEL_COMMAND
    told = firmware.check((frame_id, encode(frame_id, WheelCommand(0.0, 0.0, enable=False), n)) for n in counters)
    assert [t.verdict for t in told] == verdicts
    assert told[-1].lost == lost


@pytest.mark.compiler
def test_c_follows_any_sequence_of_counters_as_we_do(firmware: Firmware) -> None:
    dice = random.Random(7)  # noqa: S311 - the same sequence every time is wanted
    counters = list(itertools.accumulate(dice.choices(range(16), k=2_000)))
    frames = [(FrameId.BOARD_SETUP, encode(FrameId.BOARD_SETUP, BoardSetup(0.05), n)) for n in counters]
    ours, told = CounterCheck(), firmware.check(frames)
    assert [t.verdict == TAKEN for t in told] == [ours.accepts(n % 16) for n in counters]
    assert told[-1].lost == ours.lost > 0


@pytest.mark.compiler
def test_c_codec_reports_a_value_out_of_range(firmware: Firmware, reference_crc: Callable[[bytes], int]) -> None:
    body = b"\x00\x80\x00\x00\x01\x00\x00"  # -32.768 V on the left
    (told,) = firmware.check([(FrameId.WHEEL_COMMAND, body + bytes((reference_crc(body + b"\x10\x01"),)))])
    assert (told.verdict, told.in_range) == (TAKEN, False)


def test_command_writes_and_lists_the_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new" / "folder"
    assert main([str(folder)]) == 0
    told = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert sorted(told) == sorted(folder.iterdir()) == [folder / name for name in NAMES]


def test_a_missing_cantools_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert main([str(tmp_path / "out")]) == 1
    said = capsys.readouterr()
    assert said.err == "cantools is not installed and makes the C code: pip install cantools\n"
    assert said.out == ""
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert main([str(tmp_path / "file")]) == 1
    said = capsys.readouterr().err
    assert said == f"cannot write the C files to {tmp_path / 'file'}: File exists; name another folder\n"


@pytest.mark.parametrize(
    ("program", "said"),
    [("import sys; sys.exit('no such message')", "no such message"), ("exit(1)", "no error message")],
)
def test_cantools_error_is_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, said: str) -> None:
    script = tmp_path / "python"
    script.write_text(f"#!{sys.executable}\n{program}\n", encoding="utf-8")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    with pytest.raises(CodecError, match=f"^cantools generate_c_source failed on wheel_board.dbc: {said}$"):
        generate(tmp_path / "out")


def test_it_runs_as_a_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["codec", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(codec.__file__, run_name="__main__")
    assert ended.value.code == 0
    assert len(capsys.readouterr().out.splitlines()) == len(NAMES)

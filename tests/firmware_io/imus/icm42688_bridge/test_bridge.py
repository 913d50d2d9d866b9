# SPDX-License-Identifier: MIT
"""The bridge's program, compiled for this computer; a few lines of C++ play the sensor and the board's library."""

import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from segway_ecc.firmware_io.imus.icm42688_bridge import frames
from segway_ecc.firmware_io.imus.icm42688_bridge.frames import BridgeCodec, read_measurement

PROGRAM = Path(frames.__file__).with_name("bridge.ino")
BOARD = r"""
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
typedef unsigned char byte;
const int OUTPUT = 1, LOW = 0, HIGH = 1, MSBFIRST = 1, SPI_MODE0 = 0;
uint32_t now_us = 0;
uint8_t registers[128];
int address = -1;
bool answers = true;
uint32_t micros() { return now_us += 10; }
void delay(int) {}
void pinMode(int, int) {}
void digitalWrite(int, int level) { if (level) address = -1; }
struct SPISettings { SPISettings(long, int, int) {} };
struct {
  void begin() {}
  void beginTransaction(const SPISettings &) {}
  void endTransaction() {}
  uint8_t transfer(uint8_t value) {
    if (address < 0) { address = value; return 0; }
    int place = address++ & 0x7F;
    if (!(address & 0x80)) { registers[place] = value; return 0; }
    return answers ? registers[place] : 0;
  }
} SPI;
struct {
  void begin(long) {}
  void write(const uint8_t *data, int length) { fwrite(data, 1, length, stdout); }
} Serial1;
"""
MAIN = r"""
int main() {
  setup();
  registers[WHO_AM_I] = SENSOR_ID;
  for (int i = 0; i < 14; i++) registers[TEMP_DATA1 + i] = SAMPLE[i];
  while (now_us < 30000) loop();
  answers = false;
  while (now_us < 60000) loop();
  answers = true;
  while (now_us < 80000) loop();
  fprintf(stderr, "%02x %02x %02x", registers[0x4E], registers[0x4F], registers[0x50]);
}
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_its_packets_are_what_the_codec_reads(tmp_path: Path) -> None:
    # In the order of the registers, high byte first: temperature, force, rate.
    sample = struct.pack(">7h", 265, 0, 1_024, 2_048, 1_638, -164, 0)
    source = tmp_path / "bridge.cpp"
    program = PROGRAM.read_text("utf-8").replace("#include <SPI.h>", BOARD)
    source.write_text(f"{program}\nconst uint8_t SAMPLE[] = {{{', '.join(map(str, sample))}}};{MAIN}", "utf-8")
    built = tmp_path / "bridge"
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", "-o", str(built), str(source)], check=True)  # noqa: S607
    done = subprocess.run([str(built)], check=True, capture_output=True)
    found = [read_measurement(frame.data) for frame in BridgeCodec().decode(done.stdout, 0)]
    assert [measurement.number for measurement in found] == list(range(len(found)))
    assert 8 <= len(found) <= 10, "one every 5 ms, and none while the sensor does not answer"
    assert {measurement[1:] for measurement in found} == {found[0][1:]}
    assert found[0].rate[0] == pytest.approx(1.745, abs=0.001)
    assert found[0].force[2] == pytest.approx(9.80665)
    assert found[0].temperature == pytest.approx(27.0, abs=0.1)
    assert done.stderr == b"0f 06 06"

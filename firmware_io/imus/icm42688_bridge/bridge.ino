// SPDX-License-Identifier: MIT
// Sends the measurements of an ICM-42688-P on Serial1, every 5 ms: the means of five, one each millisecond.
//
// For a Raspberry Pi Pico (RP2040, Arduino-Pico) or any board of Arduino with SPI and a second serial port, at 3.3 V.
// A packet has 20 bytes, its numbers little-endian, but for the checksum:
//   0xA5 0x5A, counter (uint16), angular velocity x, y, z (int16, 2000/32768 deg/s), specific force x, y, z (int16,
//   16/32768 g), temperature (int16, 1/132.48 K from 25 C), CRC-16/XMODEM of all after 0x5A, high byte first.
// Registers: datasheet DS-000347 of TDK, bank 0. The packets stop where the sensor does not answer as what it is.
#include <SPI.h>

const int CHIP_SELECT = 17;
const long BAUD = 460800;
const uint8_t READ = 0x80, SENSOR_ID = 0x47;
const uint8_t DEVICE_CONFIG = 0x11, TEMP_DATA1 = 0x1D, INTF_CONFIG1 = 0x4D, PWR_MGMT0 = 0x4E, GYRO_CONFIG0 = 0x4F,
              ACCEL_CONFIG0 = 0x50, WHO_AM_I = 0x75;
const SPISettings SPEED(8000000, MSBFIRST, SPI_MODE0);
const int VALUES = 7, SAMPLES = 5;  // temperature, force, rate: in the order of the registers
int32_t sums[VALUES];
int samples = 0;
uint16_t counter = 0;
uint32_t due_us;

void transfer(uint8_t address, uint8_t *data, int length) {
  SPI.beginTransaction(SPEED);
  digitalWrite(CHIP_SELECT, LOW);
  SPI.transfer(address);
  for (int i = 0; i < length; i++) data[i] = SPI.transfer(data[i]);
  digitalWrite(CHIP_SELECT, HIGH);
  SPI.endTransaction();
}

void set_register(uint8_t address, uint8_t value) {
  transfer(address, &value, 1);
  delay(50);  // gyroscope and reset need up to 45 ms
}

void set_up() {
  set_register(DEVICE_CONFIG, 0x01);  // reset
  set_register(INTF_CONFIG1, 0x51);   // as after reset, with AFSR off: it makes the rate stall near full scale
  set_register(GYRO_CONFIG0, 0x06);   // 2000 deg/s, 1 kHz
  set_register(ACCEL_CONFIG0, 0x06);  // 16 g, 1 kHz
  set_register(PWR_MGMT0, 0x0F);      // both on, low noise
}

void send_means() {
  uint8_t packet[20] = {0xA5, 0x5A, (uint8_t)counter, (uint8_t)(counter >> 8)};
  for (int i = 0; i < VALUES; i++) {
    int place = i == 0 ? 16 : i < 4 ? 10 + 2 * (i - 1) : 4 + 2 * (i - 4);
    int16_t mean = (int16_t)lround((double)sums[i] / SAMPLES);
    packet[place] = (uint8_t)mean;
    packet[place + 1] = (uint8_t)(mean >> 8);
    sums[i] = 0;
  }
  uint16_t crc = 0;
  for (int i = 2; i < 18; i++) {
    crc ^= (uint16_t)packet[i] << 8;
    for (int bit = 0; bit < 8; bit++) crc = crc & 0x8000 ? (uint16_t)(crc << 1) ^ 0x1021 : (uint16_t)(crc << 1);
  }
  packet[18] = (uint8_t)(crc >> 8);
  packet[19] = (uint8_t)crc;
  Serial1.write(packet, sizeof packet);
  counter++;
}

void setup() {
  pinMode(CHIP_SELECT, OUTPUT);
  digitalWrite(CHIP_SELECT, HIGH);
  SPI.begin();
  Serial1.begin(BAUD);
  set_up();
  due_us = micros();
}

void loop() {
  if ((int32_t)(micros() - due_us) < 0) return;
  due_us += 1000;
  uint8_t id = 0, data[2 * VALUES] = {0};
  transfer(WHO_AM_I | READ, &id, 1);
  if (id != SENSOR_ID) {  // nothing is sent, until it answers again
    samples = 0;
    for (int i = 0; i < VALUES; i++) sums[i] = 0;
    set_up();
    due_us = micros();
    return;
  }
  transfer(TEMP_DATA1 | READ, data, sizeof data);
  for (int i = 0; i < VALUES; i++) sums[i] += (int16_t)((data[2 * i] << 8) | data[2 * i + 1]);
  if (++samples < SAMPLES) return;
  samples = 0;
  send_means();
}

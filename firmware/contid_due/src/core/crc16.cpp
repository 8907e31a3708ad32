// Computes CRC-16-CCITT by nibbles.
#include "crc16.h"

namespace contid {

namespace {
// 32 bytes of table instead of 512, in a third of the time of single bits.
const uint16_t TABLE[16] = {0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
                            0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF};
}  // namespace

uint16_t crc16(const uint8_t* data, size_t size, uint16_t crc) {
  uint32_t value = crc;
  for (size_t i = 0; i < size; ++i) {
    value = ((value << 4) & 0xFFFFu) ^ TABLE[((value >> 12) ^ (data[i] >> 4)) & 0x0Fu];
    value = ((value << 4) & 0xFFFFu) ^ TABLE[((value >> 12) ^ data[i]) & 0x0Fu];
  }
  return static_cast<uint16_t>(value);
}

}  // namespace contid

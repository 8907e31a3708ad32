// CRC-16-CCITT as Python's binascii.crc_hqx computes it: polynomial 0x1021, most significant bit first.
#ifndef CONTID_CRC16_H
#define CONTID_CRC16_H

#include <stddef.h>
#include <stdint.h>

namespace contid {

const uint16_t CRC_START = 0xFFFF;

uint16_t crc16(const uint8_t* data, size_t size, uint16_t crc);

}  // namespace contid

#endif

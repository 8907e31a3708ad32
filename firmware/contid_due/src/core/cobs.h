// Consistent overhead byte stuffing: a frame without zeros, so that zero ends a frame.
#ifndef CONTID_COBS_H
#define CONTID_COBS_H

#include <stddef.h>
#include <stdint.h>

namespace contid {

// Most bytes `cobs_encode` makes of `size`, the ending zero not included.
constexpr size_t cobs_capacity(size_t size) { return size + size / 254 + 1; }

// Returns the number of bytes written; `out` holds at least cobs_capacity(size).
size_t cobs_encode(const uint8_t* data, size_t size, uint8_t* out);

// Decodes a frame without its ending zero, in place. Returns the size, or 0 when it is no valid frame.
size_t cobs_decode(uint8_t* data, size_t size);

}  // namespace contid

#endif

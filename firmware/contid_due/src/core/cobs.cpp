// Encodes and decodes COBS frames.
#include "cobs.h"

namespace contid {

size_t cobs_encode(const uint8_t* data, size_t size, uint8_t* out) {
  size_t code_at = 0;
  size_t at = 1;
  uint8_t code = 1;
  for (size_t i = 0; i < size; ++i) {
    if (data[i] != 0) {
      out[at++] = data[i];
      ++code;
    }
    // A full block of 254 bytes is closed early, unless the data ends with it.
    if (data[i] == 0 || (code == 0xFF && i + 1 < size)) {
      out[code_at] = code;
      code_at = at++;
      code = 1;
    }
  }
  out[code_at] = code;
  return at;
}

size_t cobs_decode(uint8_t* data, size_t size) {
  size_t from = 0;
  size_t to = 0;
  while (from < size) {
    const uint8_t code = data[from++];
    if (code == 0) return 0;
    const size_t count = static_cast<size_t>(code - 1);
    if (count > size - from) return 0;
    for (size_t i = 0; i < count; ++i) {
      if (data[from] == 0) return 0;
      data[to++] = data[from++];
    }
    if (code != 0xFF && from < size) data[to++] = 0;
  }
  return to;
}

}  // namespace contid

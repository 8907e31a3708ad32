// Little-endian reading and writing with bounds: a reader past its end stays failed and returns zeros.
#ifndef CONTID_BYTES_H
#define CONTID_BYTES_H

#include <stddef.h>
#include <stdint.h>

#include "crc16.h"

namespace contid {

class Reader {
 public:
  Reader(const uint8_t* data, size_t size) : data_(data), size_(size), at_(0), ok_(true) {}

  uint8_t u8() { return need(1) ? data_[at_++] : static_cast<uint8_t>(0); }
  uint16_t u16() {
    const uint32_t low = u8();
    const uint32_t high = u8();
    return static_cast<uint16_t>(low | (high << 8));
  }
  uint32_t u32() {
    const uint32_t low = u16();
    const uint32_t high = u16();
    return low | (high << 16);
  }
  int16_t i16() { return static_cast<int16_t>(u16()); }
  int32_t i32() { return static_cast<int32_t>(u32()); }

  uint16_t crc_of_rest() const { return crc16(data_ + at_, size_ - at_, CRC_START); }

  bool ok() const { return ok_; }
  size_t at() const { return at_; }
  size_t left() const { return size_ - at_; }
  bool finished() const { return ok_ && at_ == size_; }

 private:
  bool need(size_t count) {
    if (!ok_ || size_ - at_ < count) ok_ = false;
    return ok_;
  }

  const uint8_t* data_;
  size_t size_;
  size_t at_;
  bool ok_;
};

class Writer {
 public:
  Writer(uint8_t* data, size_t capacity) : data_(data), capacity_(capacity), at_(0) {}

  void u8(uint32_t value) {
    if (at_ < capacity_) data_[at_++] = static_cast<uint8_t>(value & 0xFFu);
  }
  void u16(uint32_t value) {
    u8(value);
    u8(value >> 8);
  }
  void u32(uint32_t value) {
    u16(value);
    u16(value >> 16);
  }
  void i16(int32_t value) { u16(static_cast<uint32_t>(value)); }
  void i32(int32_t value) { u32(static_cast<uint32_t>(value)); }

  size_t size() const { return at_; }

 private:
  uint8_t* data_;
  size_t capacity_;
  size_t at_;
};

}  // namespace contid

#endif

// Collects frames from bytes, checks their CRC and frames the answers.
#include "link.h"

#include "crc16.h"

namespace contid {

size_t seal(uint8_t* payload, size_t size, uint8_t* wire) {
  const uint16_t crc = crc16(payload, size, CRC_START);
  payload[size] = static_cast<uint8_t>(crc & 0xFFu);
  payload[size + 1] = static_cast<uint8_t>(crc >> 8);
  const size_t encoded = cobs_encode(payload, size + CRC_SIZE, wire);
  wire[encoded] = 0;
  return encoded + 1;
}

size_t Link::take(uint8_t byte, Board& board) {
  if (byte != 0) {
    if (size_ < MAX_FRAME) {
      frame_[size_++] = byte;
    } else {
      too_long_ = true;
    }
    return 0;
  }
  const size_t size = size_;
  const bool too_long = too_long_;
  clear();
  if (size == 0) return 0;  // zeros between frames resynchronise; they are no frame
  const size_t payload = too_long ? 0 : cobs_decode(frame_, size);
  if (payload < HEADER_SIZE + CRC_SIZE) {
    board.count_bad_frame();
    return 0;
  }
  const size_t body = payload - CRC_SIZE;
  const uint32_t crc = static_cast<uint32_t>(frame_[body] | (frame_[body + 1] << 8));
  if (crc != crc16(frame_, body, CRC_START)) {
    board.count_bad_frame();
    return 0;
  }
  uint8_t answer[MAX_ANSWER + CRC_SIZE];
  const size_t answered = board.answer(frame_, body, answer, MAX_ANSWER, port_);
  return answered == 0 ? 0 : seal(answer, answered, reply_);
}

}  // namespace contid

// One port: received bytes to frames to answers.
#ifndef CONTID_LINK_H
#define CONTID_LINK_H

#include "board.h"
#include "cobs.h"

namespace contid {

class Link {
 public:
  static const size_t MAX_FRAME = MAX_PAYLOAD + CRC_SIZE + (MAX_PAYLOAD + CRC_SIZE) / 254 + 1;
  static const size_t MAX_REPLY = MAX_ANSWER + CRC_SIZE + (MAX_ANSWER + CRC_SIZE) / 254 + 2;

  void start(PortId port = PortId::NATIVE) {
    port_ = port;
    clear();
  }

  // Takes one byte. Returns the size of the answer now in reply(), or 0.
  size_t take(uint8_t byte, Board& board);
  const uint8_t* reply() const { return reply_; }

 private:
  void clear() {
    size_ = 0;
    too_long_ = false;
  }

  PortId port_;
  uint8_t frame_[MAX_FRAME];
  uint8_t reply_[MAX_REPLY];
  size_t size_;
  bool too_long_;
};

// Appends the CRC to `size` bytes of payload (two more fit), encodes, ends with zero. Returns the size on the wire.
size_t seal(uint8_t* payload, size_t size, uint8_t* wire);

}  // namespace contid

#endif

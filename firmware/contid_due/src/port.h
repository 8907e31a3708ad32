// A port of the board: frames in, and an answer that waits until the port takes it. A port that takes nothing loses
// the answer; it never stops loop().
#ifndef CONTID_PORT_H
#define CONTID_PORT_H

#include "core/link.h"

namespace contid {

struct Port {
  static const uint32_t WRITE_TIMEOUT_MS = 50;

  Link link;
  const uint8_t* waiting;
  size_t left, sent;
  uint32_t since_ms;
  bool torn;  // a part of an answer went out, and the rest never will

  void start() {
    link.start(PortId::NATIVE);
    left = 0;
    sent = 0;
    torn = false;
  }
  void take(uint8_t byte, Board& board) {
    left = link.take(byte, board);
    waiting = link.reply();
    sent = 0;
    since_ms = board.uptime_ms();
  }
  void took(size_t size) {
    waiting += size;
    left -= size;
    sent += size;
  }
  void give_up_in_time(Board& board) {
    if (left == 0 || board.uptime_ms() - since_ms < WRITE_TIMEOUT_MS) return;
    left = 0;
    torn = sent > 0;
    board.count_dropped_answer();
  }
};

}  // namespace contid

#endif

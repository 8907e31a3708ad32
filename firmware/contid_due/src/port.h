// A port of the board: frames in, and an answer that waits until the port takes it. A port that takes nothing loses
// the answer; it never stops loop().
#ifndef CONTID_PORT_H
#define CONTID_PORT_H

#include "core/link.h"

namespace contid {

struct Port {
  static const uint32_t WRITE_TIMEOUT_MS = 50;

  Link link;
  const uint8_t* waiting;  // rest of the answer that the port has not taken
  size_t left, sent;       // bytes of the answer: to be taken, taken
  uint32_t since_ms;       // uptime when the answer was composed
  bool torn;               // a part of an answer went out, and the rest never will

  void start() {
    link.start(PortId::NATIVE);
    left = 0;
    sent = 0;
    torn = false;
  }
  // Pass a received byte on; the last one of a request makes an answer wait.
  void take(uint8_t byte, Board& board) {
    left = link.take(byte, board);
    waiting = link.reply();
    sent = 0;
    since_ms = board.uptime_ms();
  }
  // The port took this many bytes of the answer.
  void took(size_t size) {
    waiting += size;
    left -= size;
    sent += size;
  }
  // Drop the answer that the port has not taken within the time-out.
  void drop_overdue(Board& board) {
    if (left == 0 || board.uptime_ms() - since_ms < WRITE_TIMEOUT_MS) return;
    left = 0;
    torn = sent > 0;
    board.count_dropped_answer();
  }
};

}  // namespace contid

#endif

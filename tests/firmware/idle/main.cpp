// A board whose clock is set, as after weeks without a host: `at MS` sets it, `ask HEX` prints the answer.
#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>

#define private public
#include "contid_due/src/core/board.h"

using namespace contid;

int main() {
  static Board board;
  Identity identity = Identity();
  for (uint8_t& each : identity.capabilities) each = HARDWARE_DECODER;
  identity.adc_steps = 4095;
  identity.adc_mv = 3300;
  board.start(identity, nullptr, nullptr);
  const Inputs in = Inputs();
  Outputs out;
  std::string line, verb, rest;
  while (std::getline(std::cin, line)) {
    std::istringstream(line) >> verb >> rest;
    if (verb == "at") {
      board.now_ = static_cast<uint32_t>(std::stoul(rest)) - 1;
      board.tick(in, out);
      continue;
    }
    uint8_t request[MAX_PAYLOAD], answer[MAX_ANSWER];
    for (size_t i = 0; i < rest.size() / 2; ++i)
      request[i] = static_cast<uint8_t>(std::stoul(rest.substr(2 * i, 2), nullptr, 16));
    const size_t size = board.answer(request, rest.size() / 2, answer, sizeof(answer));
    for (size_t i = 0; i < size; ++i) std::printf("%02x", answer[i]);
    std::printf("\n");
  }
}

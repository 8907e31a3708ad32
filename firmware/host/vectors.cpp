// Runs firmware/vectors/vectors.txt against the core: prints the first difference of every line, exit code 1.
//
//   contid_due_vectors vectors.txt

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "../contid_due/src/core/crc16.h"
#include "../contid_due/src/core/link.h"
#include "identity.h"

namespace {

using contid::Board;

std::vector<uint8_t> bytes_of(const std::string& hex) {
  std::vector<uint8_t> bytes;
  for (size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes.push_back(static_cast<uint8_t>(std::strtoul(hex.substr(i, 2).c_str(), nullptr, 16)));
  }
  return bytes;
}

std::string hex_of(const uint8_t* bytes, size_t size) {
  std::string text;
  char two[3];
  for (size_t i = 0; i < size; ++i) {
    std::snprintf(two, sizeof two, "%02x", bytes[i]);
    text += two;
  }
  return text;
}

// Payload of a frame on the wire (ending zero included), "" when it is none.
std::string open_frame(std::vector<uint8_t> wire) {
  if (wire.empty() || wire.back() != 0) return "";
  const size_t size = contid::cobs_decode(wire.data(), wire.size() - 1);
  if (size < contid::CRC_SIZE) return "";
  const size_t body = size - contid::CRC_SIZE;
  const uint16_t crc = contid::crc16(wire.data(), body, contid::CRC_START);
  if (wire[body] != (crc & 0xFF) || wire[body + 1] != crc >> 8) return "";
  return hex_of(wire.data(), body);
}

std::vector<uint8_t> sealed(const std::string& hex) {
  std::vector<uint8_t> payload = bytes_of(hex);
  const size_t size = payload.size();
  payload.resize(size + contid::CRC_SIZE);
  std::vector<uint8_t> wire(contid::cobs_capacity(payload.size()) + 1);
  wire.resize(contid::seal(payload.data(), size, wire.data()));
  return wire;
}

}  // namespace

int main(int argc, char** argv) {
  std::ifstream file(argc > 1 ? argv[1] : "vectors.txt");
  if (!file) {
    std::perror("vectors");
    return 2;
  }
  static Board board;
  static contid::Link link;
  contid::Inputs inputs = contid::Inputs();
  contid::Outputs outputs = contid::Outputs();
  std::string line, answer;
  int number = 0, differences = 0, checked = 0;
  while (std::getline(file, line)) {
    ++number;
    std::istringstream in(line);
    std::string item, first, second;
    in >> item >> first >> second;
    std::string expected = first, found = first;
    if (item == "frame") {
      const std::vector<uint8_t> wire = sealed(first);
      found = hex_of(wire.data(), wire.size()) + " " + open_frame(bytes_of(second));
      expected = second + " " + first;
      ++checked;
    } else if (item == "noise") {
      expected = "";
      std::vector<uint8_t> wire = bytes_of(first);
      wire.push_back(0);
      found = open_frame(wire);
      ++checked;
    } else if (item == "board") {
      const contid::Role role = first == "motor" ? contid::Role::MOTOR : contid::Role::PRESSURE;
      board.start(contid::emulated_identity(role), nullptr, nullptr);
      link.start();
      inputs = contid::Inputs();
    } else if (item == "tick") {
      for (int i = std::atoi(first.c_str()); i > 0; --i) board.tick(inputs, outputs);
    } else if (item == "count") {
      inputs.count[std::atoi(first.c_str())] = std::atoi(second.c_str());
    } else if (item == "analog") {
      inputs.analog[std::atoi(first.c_str())] = std::atoi(second.c_str());
    } else if (item == ">") {
      answer.clear();
      for (uint8_t byte : sealed(first)) {
        const size_t size = link.take(byte, board);
        if (size > 0) answer = open_frame(std::vector<uint8_t>(link.reply(), link.reply() + size));
      }
    } else if (item == "<") {
      found = answer;
      ++checked;
    }
    if (found != expected) {
      ++differences;
      std::cout << "line " << number << ": expected " << expected << "\n  found " << found << "\n";
    }
  }
  std::cout << checked << " vectors, " << differences << " differences\n";
  return differences == 0 ? 0 : 1;
}

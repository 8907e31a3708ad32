// Fuzzes the parser and the states behind it, guided by coverage.
//
// With clang: clang++ -std=gnu++17 -DCONTID_LIBFUZZER -fsanitize=fuzzer,address,undefined ... (libFuzzer).
// With gcc:   g++ -std=gnu++17 -fsanitize=address,undefined -fsanitize-coverage=trace-pc ... (the loop below):
//             contid_due_fuzz INPUTS [SEED] < seeds, one hexadecimal input per line.
// firmware/fuzz.py builds and runs either.
//
// An input is a list of operations: raw bytes on the wire, a payload that gets its CRC and COBS (so that the
// fuzzer reaches what lies behind them), one that also gets the configuration's CRC, a configuration that gets its
// own, and ticks with inputs. Besides the sanitizers' checks, these must hold after every tick: no duty beyond
// full, none on a channel that is not commanded or held, and no armed channel that was not fed in time.

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <string>
#include <vector>

#include "../contid_due/src/core/crc16.h"
#include "../contid_due/src/core/link.h"

namespace {

using contid::State;

contid::Board board;
contid::Link line;
contid::Inputs inputs;
contid::Outputs outputs;
uint16_t config_crc;
uint32_t watchdog_ms;
int pulsed[contid::CHANNELS];  // ticks of the pulse of each channel

[[noreturn]] void broken(const char* what) {
  std::fprintf(stderr, "invariant broken: %s\n", what);
  std::abort();
}

void send(const uint8_t* bytes, size_t size) {
  for (size_t i = 0; i < size; ++i) {
    const size_t answer = line.take(bytes[i], board);
    if (answer == 0) continue;
    if (answer > contid::Link::MAX_REPLY || line.reply()[answer - 1] != 0) broken("an answer is no frame");
    uint8_t copy[contid::Link::MAX_REPLY];
    std::memcpy(copy, line.reply(), answer);
    const size_t payload = contid::cobs_decode(copy, answer - 1);
    if (payload < contid::HEADER_SIZE + contid::CRC_SIZE) broken("an answer is too short");
    // Remember what the board was configured with, as a host would.
    if (copy[1] == contid::CONFIGURED) config_crc = static_cast<uint16_t>(copy[3] | (copy[4] << 8));
  }
}

void send_sealed(const uint8_t* bytes, size_t size) {
  uint8_t payload[contid::MAX_PAYLOAD + contid::CRC_SIZE];
  uint8_t wire[contid::Link::MAX_FRAME + 8];
  size = size < contid::MAX_PAYLOAD ? size : contid::MAX_PAYLOAD;
  if (size > 0) std::memcpy(payload, bytes, size);
  send(wire, contid::seal(payload, size, wire));
}

void tick(int32_t count, int32_t analog, uint8_t faults) {
  for (int i = 0; i < contid::CHANNELS; ++i) {
    inputs.count[i] = static_cast<int32_t>(static_cast<uint32_t>(count) * static_cast<uint32_t>(i + 1));
    inputs.analog[i] = (analog + i) & 0xFFF;
  }
  inputs.bridge_faults = faults;
  board.tick(inputs, outputs);
  for (uint8_t i = 0; i < contid::CHANNELS; ++i) {
    const contid::Output& out = outputs.channel[i];
    const State state = board.state(i);
    if (out.duty > contid::DUTY_FULL || out.duty < -contid::DUTY_FULL) broken("duty beyond full");
    if (board.role() == contid::Role::PRESSURE && out.duty < 0) broken("a regulator below zero");
    if (out.drive != contid::Drive::RUN && out.duty != 0) broken("duty without drive");
    if (state == State::OFF && out.drive != contid::Drive::OFF) broken("an unconfigured channel drives");
    if (board.role() == contid::Role::MOTOR && state == State::READY && out.drive == contid::Drive::RUN) {
      broken("a motor drives before it was armed");
    }
    const bool pulsing = state == State::PULSING && out.drive == contid::Drive::RUN;
    pulsed[i] = pulsing ? pulsed[i] + 1 : 0;
    if (pulsing && (out.duty > contid::PULSE_DUTY || out.duty < -contid::PULSE_DUTY)) broken("a pulse beyond its duty");
    if (pulsed[i] > contid::PULSE_MS) broken("a pulse beyond its time");
    const bool commanded = state == State::ARMED || state == State::HOMING;
    if (commanded && board.silence_ms() >= watchdog_ms) broken("the watchdog did not trip");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < 1) return 0;
  contid::Identity identity = contid::Identity();
  identity.role = (data[0] & 1) == 0 ? contid::Role::MOTOR : contid::Role::PRESSURE;
  identity.pins = "fuzzed";
  identity.adc_steps = 4095;
  for (uint8_t& capability : identity.capabilities) capability = 2;
  board.start(identity, nullptr, nullptr);
  line.start();
  config_crc = 0;
  std::fill(pulsed, pulsed + contid::CHANNELS, 0);
  watchdog_ms = 10000;  // the longest that can be configured
  size_t at = 1;
  while (at + 2 <= size) {
    const uint8_t operation = data[at];
    size_t length = data[at + 1];
    at += 2;
    if (operation % 5 == 3) length *= 3;  // configurations are long
    if (length > size - at) length = size - at;
    std::vector<uint8_t> bytes(data + at, data + at + length);
    at += length;
    switch (operation % 5) {
      case 0:
        send(bytes.data(), bytes.size());
        break;
      case 1:
        send_sealed(bytes.data(), bytes.size());
        break;
      case 2:
        if (bytes.size() >= 5) {
          bytes[0] = contid::PROTOCOL_VERSION;
          bytes[3] = static_cast<uint8_t>(config_crc & 0xFF);
          bytes[4] = static_cast<uint8_t>(config_crc >> 8);
        }
        send_sealed(bytes.data(), bytes.size());
        break;
      case 3:
        if (bytes.size() >= 9) {
          bytes[0] = contid::PROTOCOL_VERSION;
          bytes[1] = contid::CONFIGURE;
          const uint16_t crc = contid::crc16(bytes.data() + 5, bytes.size() - 5, contid::CRC_START);
          bytes[3] = static_cast<uint8_t>(crc & 0xFF);
          bytes[4] = static_cast<uint8_t>(crc >> 8);
          const uint16_t before = config_crc;
          send_sealed(bytes.data(), bytes.size());
          if (config_crc != before) watchdog_ms = static_cast<uint32_t>(bytes[6] | (bytes[7] << 8));
        }
        break;
      default: {
        int32_t count = 0;
        if (bytes.size() >= 4) std::memcpy(&count, bytes.data(), 4);
        const int32_t analog = bytes.size() >= 6 ? bytes[4] | (bytes[5] << 8) : 0;
        const uint8_t faults = bytes.size() >= 7 ? bytes[6] : 0;
        for (int i = 0; i < (operation & 31); ++i) tick(count, analog, faults);
        break;
      }
    }
  }
  return 0;
}

#ifndef CONTID_LIBFUZZER

namespace {

const size_t MAP = 1u << 16;
const size_t LONGEST = 2048;
uint8_t hit[MAP];
uint8_t seen[MAP];
uint32_t touched[MAP];
size_t touched_count;
uintptr_t previous;

uint64_t random_state;
uint32_t random_below(size_t limit) {
  random_state ^= random_state << 13;
  random_state ^= random_state >> 7;
  random_state ^= random_state << 17;
  return static_cast<uint32_t>(random_state >> 11) % static_cast<uint32_t>(limit);
}

void mutate(std::vector<uint8_t>& input, const std::vector<std::vector<uint8_t>>& corpus) {
  static const uint8_t TELLING[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 0x10, 0x20, 0x3F, 0x40, 0x7F, 0x80, 0xFE, 0xFF};
  for (uint32_t left = 1 + random_below(6); left > 0; --left) {
    const uint32_t at = random_below(input.size() + 1);
    switch (random_below(7)) {
      case 0:
        if (at < input.size()) input[at] = static_cast<uint8_t>(input[at] ^ (1u << random_below(8)));
        break;
      case 1:
        if (at < input.size()) input[at] = TELLING[random_below(sizeof TELLING)];
        break;
      case 2:
        if (at < input.size()) input[at] = static_cast<uint8_t>(random_below(256));
        break;
      case 3:
        input.insert(input.begin() + at, static_cast<uint8_t>(random_below(256)));
        break;
      case 4:
        if (at < input.size()) {
          const size_t count = 1 + random_below(8);
          input.erase(input.begin() + at, input.begin() + static_cast<long>(std::min(at + count, input.size())));
        }
        break;
      case 5: {
        const std::vector<uint8_t>& other = corpus[random_below(corpus.size())];
        if (other.size() < 2) break;
        const uint32_t from = random_below(other.size());
        const size_t count = 1 + random_below(other.size() - from);
        input.insert(input.begin() + at, other.begin() + from, other.begin() + static_cast<long>(from + count));
        break;
      }
      default:
        if (at + 4 <= input.size()) {
          const uint32_t value = random_below(2) == 0 ? 0x7FFFFFFFu : 0x80000000u;
          std::memcpy(&input[at], &value, 4);
        }
        break;
    }
  }
  if (input.size() > LONGEST) input.resize(LONGEST);
}

// Runs one input; true when it went where none went before.
bool is_new(const std::vector<uint8_t>& input) {
  touched_count = 0;
  previous = 0;
  LLVMFuzzerTestOneInput(input.data(), input.size());
  bool found = false;
  for (size_t i = 0; i < touched_count; ++i) {
    const uint32_t place = touched[i];
    // Counts in powers of two: a loop that runs much longer than before is news as well.
    uint8_t bucket = 1;
    for (uint8_t count = hit[place]; count > 1 && bucket < 128; count = static_cast<uint8_t>(count >> 1)) {
      bucket = static_cast<uint8_t>(bucket << 1);
    }
    if ((seen[place] & bucket) == 0) {
      seen[place] = static_cast<uint8_t>(seen[place] | bucket);
      found = true;
    }
    hit[place] = 0;
  }
  return found;
}

std::vector<uint8_t> current;

void save_crash(int) {
  std::signal(SIGABRT, SIG_DFL);
  std::fprintf(stderr, "crashing input: ");
  for (uint8_t byte : current) std::fprintf(stderr, "%02x", byte);
  std::fprintf(stderr, "\n");
}

}  // namespace

extern "C" __attribute__((no_sanitize_coverage, no_sanitize_address, no_sanitize_undefined)) void
__sanitizer_cov_trace_pc() {
  const uintptr_t pc = reinterpret_cast<uintptr_t>(__builtin_return_address(0));
  const uint32_t place = static_cast<uint32_t>((pc ^ (previous << 1) ^ (pc >> 16)) & (MAP - 1));
  previous = pc;
  if (hit[place] == 0 && touched_count < MAP) touched[touched_count++] = place;
  if (hit[place] < 255) ++hit[place];
}

// Every finding ends in abort(), so that the input can be reported.
extern "C" const char* __asan_default_options() { return "abort_on_error=1"; }
extern "C" const char* __ubsan_default_options() { return "abort_on_error=1:print_stacktrace=1"; }

int main(int argc, char** argv) {
  const long input_count = argc > 1 ? std::atol(argv[1]) : 10000;
  random_state = 0x9E3779B97F4A7C15ull + (argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 0);
  std::signal(SIGABRT, save_crash);
  std::vector<std::vector<uint8_t>> corpus;
  std::string text;
  while (std::getline(std::cin, text)) {
    std::vector<uint8_t> seed;
    for (size_t i = 0; i + 1 < text.size(); i += 2) {
      seed.push_back(static_cast<uint8_t>(std::strtoul(text.substr(i, 2).c_str(), nullptr, 16)));
    }
    corpus.push_back(seed);
    current = seed;
    is_new(seed);
  }
  if (corpus.empty()) corpus.push_back(std::vector<uint8_t>(1, 0));
  for (long i = 0; i < input_count; ++i) {
    current = corpus[random_below(corpus.size())];
    mutate(current, corpus);
    if (is_new(current)) corpus.push_back(current);
    if ((i & 0xFFFFF) == 0xFFFFF) std::fprintf(stderr, "%ld inputs, %zu kept\n", i + 1, corpus.size());
  }
  size_t places = 0;
  for (uint8_t one : seen) places += one != 0;
  std::printf("%ld inputs, %zu kept, %zu places\n", input_count, corpus.size(), places);
  return 0;
}

#endif

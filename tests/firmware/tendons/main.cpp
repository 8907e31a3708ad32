// Moves tendons with load cells on the firmware's core, one trial per line of stdin:
//
//   KIND SEED MOVES CONVERTER_HZ PULL NEAR CONFIGURE
//
// KIND is moves, or what fails after them: cut, loosened, jammed, open, saturated, frozen, reversed, swapped, host,
// silent; PULL the sense that tightens, NEAR the stiffness of both tendons before the capstan in N/mm, CONFIGURE the
// body of the configure message of two motors in hex. Answers `REASON STATE MS LEAST BELOW OUTWARD TENSION`: of the
// first channel its reason and state, the time from the failure to the safe state (-1: none), the least tension in N
// after the pre-tension and until the failure (host: to the end), the number of moves with less than the floor by more
// than 0.1 N, the greatest outward duty after the failure, and the tension at the end.

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "cable.h"
#include "contid_due/src/core/board.h"
#include "host/identity.h"

namespace {

using contid::State;
using tendons::Cable;

typedef std::vector<uint8_t> Bytes;
const int CHANNELS = 2;
const double FLOOR_N = 1.0, SLACK_BY_N = 0.1;
const double N_PER_MV = 50.0 / 2900.0;  // 200 mV at no tension
const double N_PER_STEP = 50.0 / 4.0e6;

void put(Bytes& to, uint32_t value, int size) {
  for (int i = 0; i < size; ++i) to.push_back(static_cast<uint8_t>(value >> 8 * i));
}

class Bench {
 public:
  Bench(std::mt19937& random, const Bytes& configure, int converter_hz, int pull, double near)
      : random_(random), hz_(converter_hz), pull_(pull), crc_(configure[0] | configure[1] << 8) {
    for (Cable& each : cable) each = tendons::drawn(random, near);
    contid::Identity identity = contid::emulated_identity(contid::Role::MOTOR);
    for (uint8_t& each : identity.capabilities) each |= contid::CELL_ANALOG | contid::CELL_CONVERTER;
    board_.start(identity, nullptr, nullptr);
    tick();
    ask(contid::CONFIGURE, configure);
    run(100);
    demand();
    masked(contid::ARM);
  }

  void tick() {
    for (int i = 0; i < CHANNELS; ++i) {
      inputs_.count[i] = cable[i].shaft.count;
      sense(i);
    }
    if (kind == "swapped") {
      std::swap(inputs_.cell_analog[0], inputs_.cell_analog[1]);
      std::swap(inputs_.cell_steps[0], inputs_.cell_steps[1]);
    }
    board_.tick(inputs_, outputs_);
    for (int i = 0; i < CHANNELS; ++i) {
      const contid::Output& out = outputs_.channel[i];
      duty[i] = out.drive == contid::Drive::RUN ? out.duty / 32767.0 : 0.0;
      cable[i].run(duty[i], pull_);
    }
    ++now;
  }
  void run(int ms) {
    for (; ms > 0; --ms) tick();
  }
  void masked(uint8_t type, uint32_t mask = 3) {
    Bytes body;
    put(body, crc_, 2);
    put(body, mask, 1);
    ask(type, body);
  }
  void demand(const double* goal = nullptr, const double* speed = nullptr) {
    Bytes body;
    put(body, crc_, 2);
    put(body, board_.uptime_ms(), 4);
    put(body, goal != nullptr ? 3 : 0, 1);
    for (int i = 0; goal != nullptr && i < CHANNELS; ++i) {
      put(body, static_cast<uint32_t>(std::lround(pull_ * goal[i] * tendons::COUNTS_PER_MM)), 4);
      put(body, static_cast<uint32_t>(std::lround(pull_ * speed[i] * tendons::COUNTS_PER_MM)), 4);
    }
    ask(contid::DEMAND, body);
  }
  bool faulty(uint8_t i = 0) const { return board_.state(i) == State::SAFE; }
  int state() const { return static_cast<int>(board_.state(0)); }
  int reason() const { return static_cast<int>(board_.reason(0)); }
  double outward(int i) const { return -pull_ * duty[i]; }

  Cable cable[CHANNELS];
  double duty[CHANNELS] = {0.0, 0.0};
  int now = 0;
  std::string kind = "moves";

 private:
  void sense(int i) {
    const double seen = cable[i].tension + std::normal_distribution<>(0.0, cable[i].noise_n)(random_);
    double mv = 200.0 + seen / N_PER_MV;
    double steps = 1.0e5 + seen / N_PER_STEP;
    if (i == 0 && kind == "open") mv = 0.0, steps = -8388608.0;
    if (i == 0 && kind == "saturated") mv = 3300.0, steps = 8388607.0;
    if (i == 0 && kind == "reversed") mv = 200.0 - (seen + 3.0) / N_PER_MV, steps = 1.0e5 - (seen + 3.0) / N_PER_STEP;
    const bool frozen = i == 0 && kind == "frozen";  // the last reading comes again and again
    if (!frozen) inputs_.cell_analog[i] = static_cast<int32_t>(std::min(4095.0, std::max(0.0, mv / 3300.0 * 4095.0)));
    const bool due = hz_ > 0 && now % std::max(1, 1000 / std::max(hz_, 1)) == i;
    const uint8_t bit = static_cast<uint8_t>(1u << i);
    inputs_.cell_fresh = static_cast<uint8_t>(inputs_.cell_fresh & ~bit);
    if (!due || (i == 0 && kind == "silent")) return;
    inputs_.cell_fresh = static_cast<uint8_t>(inputs_.cell_fresh | bit);
    if (!frozen) inputs_.cell_steps[i] = static_cast<int32_t>(steps);
  }

  void ask(uint8_t type, const Bytes& body) {
    Bytes request = {contid::PROTOCOL_VERSION, type, 0};
    request.insert(request.end(), body.begin(), body.end());
    uint8_t answer[contid::MAX_ANSWER];
    board_.answer(request.data(), request.size(), answer, sizeof answer);
    if (answer[1] != contid::REFUSED) return;
    std::fprintf(stderr, "request %d refused: %d, detail %d\n", type, answer[4], answer[5] | answer[6] << 8);
    std::exit(1);
  }

  std::mt19937& random_;
  int hz_, pull_;
  uint32_t crc_;
  contid::Board board_;
  contid::Inputs inputs_ = contid::Inputs();
  contid::Outputs outputs_ = contid::Outputs();
};

// What the host streams, and what the bodies do meanwhile, which the host believes only in part.
struct Moves {
  Moves(std::mt19937& random_, double fastest_) : random(random_), fastest(fastest_) {}

  std::mt19937& random;
  double fastest;  // of a body [mm/s]
  tendons::Way goal[CHANNELS];

  double between(double low, double high) { return std::uniform_real_distribution<>(low, high)(random); }

  void next(Bench& bench) {
    for (int i = 0; i < CHANNELS; ++i) {
      Cable& cable = bench.cable[i];
      tendons::Way way;
      way.lasts_s = between(0.35, 0.85);
      way.start_s = cable.t + between(0.0, 0.1);
      way.from = cable.rest.to;
      const double far = fastest * way.lasts_s / 1.875;  // the greatest speed of such a way
      way.to = between(std::max(-6.0, way.from - far), std::min(6.0, way.from + far));
      cable.rest = way;
      tendons::Way& demanded = goal[i];
      demanded = way;
      demanded.from = demanded_to_[i];
      // A model that is wrong: often too little for the floor.
      demanded_to_[i] = demanded.to = way.to * between(0.6, 1.4) - between(0.0, 3.0);
      demanded.start_s = cable.t + between(0.0, 0.05);
    }
  }
  void feed(Bench& bench) {
    double at[CHANNELS], speed[CHANNELS];
    for (int i = 0; i < CHANNELS; ++i) {
      at[i] = goal[i].at(bench.cable[i].t);
      speed[i] = goal[i].speed(bench.cable[i].t);
    }
    bench.demand(at, speed);
  }

 private:
  double demanded_to_[CHANNELS] = {0.0, 0.0};
};

void trial(const std::string& kind, unsigned seed, int count, int hz, int pull, double near, const Bytes& configure) {
  std::mt19937 random(seed);
  Bench bench(random, configure, hz, pull, near);
  Moves moves(random, hz > 0 ? 4.0 : 40.0);
  double least = 1e9, outward = 0.0;
  int below = 0, fault_ms = -1;
  for (int ms = 0; ms < 1500; ++ms) {  // pre-tension
    if (ms % 10 == 0) moves.feed(bench);
    bench.tick();
  }
  if (kind == "swapped") bench.kind = kind;
  for (int move = 0; move < count && !bench.faulty() && !bench.faulty(1); ++move) {
    moves.next(bench);
    if (kind == "swapped") bench.cable[1].rest = tendons::Way(), moves.goal[1] = tendons::Way();
    double lowest = 1e9;
    for (int ms = 0; ms < 1000 && !bench.faulty() && !bench.faulty(1); ++ms) {
      if (ms % 10 == 0) moves.feed(bench);
      bench.tick();
      for (const Cable& each : bench.cable) lowest = std::fmin(lowest, each.tension);
    }
    below += lowest < FLOOR_N - SLACK_BY_N;
    least = std::fmin(least, lowest);
  }
  if (kind != "moves" && kind != "swapped") {
    moves.next(bench);
    const int fails = std::uniform_int_distribution<>(0, 700)(random);
    // A cell whose readings stand still is found by motion: the robot goes on.
    const bool goes_on = kind == "frozen";
    for (int ms = 0; ms < (goes_on ? 20000 : 4000) && !(kind != "host" && bench.faulty()); ++ms) {
      if (ms == fails) {
        bench.kind = kind;
        bench.cable[0].cut = kind == "cut";
        bench.cable[0].shaft.blocked = kind == "jammed";
        if (kind == "loosened") bench.cable[0].rest.to += 25.0;
      }
      // Of a host that died nobody demands, and the bodies move.
      if ((kind == "host" || goes_on) && ms > fails && ms % 1000 == 0) moves.next(bench);
      if (ms % 10 == 0 && !(kind == "host" && ms >= fails)) moves.feed(bench);
      bench.tick();
      if (ms >= fails) outward = std::fmax(outward, bench.outward(0));
      if (goes_on && ms >= fails) least = std::fmin(least, bench.cable[0].tension);
      if (kind == "host") {
        for (const Cable& each : bench.cable) least = std::fmin(least, each.tension);
      }
      if (bench.faulty() && fault_ms < 0) fault_ms = ms - fails;
    }
    for (int ms = 0; ms < 200; ++ms) {
      bench.tick();
      if (kind != "host") outward = std::fmax(outward, bench.outward(0));
    }
  }
  std::printf("%d %d %d %.3f %d %.4f %.3f\n", bench.reason(), bench.state(), fault_ms, least, below, outward,
              bench.cable[0].tension);
}

}  // namespace

int main() {
  std::string line, kind, hex;
  while (std::getline(std::cin, line)) {
    unsigned seed;
    int count, hz, pull;
    double near;
    std::istringstream(line) >> kind >> seed >> count >> hz >> pull >> near >> hex;
    Bytes configure;
    for (size_t i = 0; i + 1 < hex.size(); i += 2) {
      configure.push_back(static_cast<uint8_t>(std::strtoul(hex.substr(i, 2).c_str(), nullptr, 16)));
    }
    trial(kind, seed, count, hz, pull, near, configure);
    std::fflush(stdout);
  }
  return 0;
}

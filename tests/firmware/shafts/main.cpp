// Runs shafts with broken and with whole encoders on the firmware's core, one trial per line of stdin:
//
//   armed|homing|healthy FAULT SEED SPEED PLAY CONFIGURE
//
// FAULT is none, dead, track_a, track_b or reversed; SPEED the demanded one, or that of homing, in counts/s; PLAY the
// most before the encoder, in counts; CONFIGURE the body of the configure message in hex. Answers `REASON STATE MS
// AT_FAULT AT_REST TRAVEL`: the channel's reason and state, the time from the fault's onset, the farthest place from
// that of the onset until the board noticed and until the shaft rested, and the way of the shaft until then, in counts.

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "contid_due/src/core/board.h"
#include "host/identity.h"
#include "shaft.h"

namespace {

using contid::State;
using shafts::Fault;
using shafts::Shaft;

typedef std::vector<uint8_t> Bytes;

void put(Bytes& to, uint32_t value, int size) {
  for (int i = 0; i < size; ++i) to.push_back(static_cast<uint8_t>(value >> 8 * i));
}

// One channel of a board, its host, and what turns on it.
class Bench {
 public:
  Bench(const Shaft& made, const Bytes& configure) : shaft(made), crc_(configure[0] | configure[1] << 8) {
    board_.start(contid::emulated_identity(contid::Role::MOTOR), nullptr, nullptr);
    tick();
    ask(contid::CONFIGURE, configure);
    run(20);
  }

  // The timer interrupt and the millisecond after it.
  void tick() {
    inputs_.count[0] = shaft.count;
    board_.tick(inputs_, outputs_);
    const contid::Output& out = outputs_.channel[0];
    duty_ = out.drive == contid::Drive::RUN ? out.duty / 32767.0 : 0.0;
    const double before = shaft.angle;
    shaft.run(duty_);
    way_ += std::fabs(shaft.angle - before);
    ++now_;
  }
  void run(int ms) {
    for (; ms > 0; --ms) tick();
  }
  void masked(uint8_t type) {
    Bytes body;
    put(body, crc_, 2);
    put(body, 1, 1);
    ask(type, body);
  }
  // Feeds the watchdog, with a demand for the channel or without.
  void demand(const double* goal = nullptr, const double* velocity = nullptr) {
    Bytes body;
    put(body, crc_, 2);
    put(body, board_.uptime_ms(), 4);
    put(body, goal != nullptr, 1);
    if (goal != nullptr) {
      put(body, static_cast<uint32_t>(static_cast<int32_t>(std::lround(*goal))), 4);
      const int32_t given = velocity ? static_cast<int32_t>(std::lround(*velocity)) : contid::NO_VELOCITY;
      put(body, static_cast<uint32_t>(given), 4);
    }
    ask(contid::DEMAND, body);
  }
  bool searching() const { return board_.state(0) == State::HOMING; }
  bool faulty() const { return board_.state(0) == State::SAFE; }
  int state() const { return static_cast<int>(board_.state(0)); }
  int reason() const { return static_cast<int>(board_.reason(0)); }
  double duty() const { return duty_; }
  int now() const { return now_; }
  double way() const { return way_; }

  Shaft shaft;

 private:
  void ask(uint8_t type, const Bytes& body) {
    Bytes request = {contid::PROTOCOL_VERSION, type, 0};
    request.insert(request.end(), body.begin(), body.end());
    uint8_t answer[contid::MAX_ANSWER];
    board_.answer(request.data(), request.size(), answer, sizeof answer);
    if (answer[1] != contid::REFUSED) return;
    std::fprintf(stderr, "request %d refused: %d, detail %d\n", type, answer[4], answer[5] | answer[6] << 8);
    std::exit(1);
  }

  contid::Board board_;
  contid::Inputs inputs_ = contid::Inputs();
  contid::Outputs outputs_ = contid::Outputs();
  uint32_t crc_;
  double duty_ = 0.0, way_ = 0.0;
  int now_ = 0;
};

// The onset of a fault, and how far the shaft went from there.
struct Onset {
  int at_ms = 0;
  double angle = 0.0, way = 0.0, farthest = 0.0, at_fault = 0.0;
  int fault_ms = -1;

  void begin(const Bench& bench) {
    at_ms = bench.now();
    angle = bench.shaft.angle;
    way = bench.way();
  }
  void look(const Bench& bench) {
    farthest = std::fmax(farthest, std::fabs(bench.shaft.angle - angle));
    if (fault_ms >= 0 || !bench.faulty()) return;
    fault_ms = bench.now() - at_ms;
    at_fault = farthest;
  }
};

void report(Bench& bench, Onset& onset) {
  const int state = bench.state(), reason = bench.reason();
  if (onset.fault_ms < 0) onset.at_fault = onset.farthest;
  for (int i = 0; i < 1500 && bench.faulty(); ++i) {
    bench.tick();
    onset.look(bench);
  }
  std::printf("%d %d %d %.2f %.2f %.2f\n", reason, state, onset.fault_ms, onset.at_fault, onset.farthest,
              bench.way() - onset.way);
}

// What a host streams: lines, waves, steps, pauses.
struct Stream {
  double speed, from = 0.0;
  int kind;
  double period;

  Stream(double speed_, std::mt19937& random) : speed(speed_) {
    kind = std::uniform_int_distribution<>(0, 2)(random);
    period = std::uniform_real_distribution<>(0.5, 4.0)(random);
    if (random() & 1) speed = -speed;
  }
  void at(double t, double& goal, double& velocity) const {
    const double turns = 2.0 * 3.14159265358979 / period;
    if (kind == 0) {
      goal = from + speed / turns * std::sin(turns * t);
      velocity = speed * std::cos(turns * t);
    } else {
      goal = from + speed * t;
      velocity = speed;
    }
  }
};

void armed(std::mt19937& random, Fault fault, double speed, double play, const Bytes& configure) {
  Bench bench(shafts::within_rating(random, true, play), configure);
  bench.demand();
  bench.masked(contid::ARM);
  for (int ms = 0; ms < 300; ms += 10) {  // it settles against its load
    bench.demand();
    bench.run(10);
  }
  const int start = bench.now();
  Stream stream(speed, random);
  stream.from = bench.shaft.count;
  const int at = std::uniform_int_distribution<>(-200, 1500)(random);
  Onset onset;
  for (int ms = 0; ms < 8000 && !bench.faulty(); ++ms) {
    if (ms == (at < 0 ? 0 : at)) {
      bench.shaft.fail(fault);
      onset.begin(bench);
    }
    if (ms % 5 == 0) {
      double goal, velocity;
      stream.at((bench.now() - start) / 1000.0, goal, velocity);
      bench.demand(&goal, &velocity);
    }
    bench.tick();
    if (bench.shaft.fault != Fault::NONE) onset.look(bench);
  }
  report(bench, onset);
}

void homing(std::mt19937& random, Fault fault, double speed, double play, const Bytes& configure) {
  Shaft made = shafts::within_rating(random, true, play);
  // What the file lets homing drive is enough for this shaft.
  made.friction = std::fmin(made.friction, 0.12);
  made.stiction = made.friction;
  made.load *= 0.2;
  made.swing *= 0.2;
  const double ahead = 40.0 + speed * std::uniform_real_distribution<>(0.2, 1.5)(random);
  made.high = made.angle + ahead;
  // A first pass finds how long the whole search takes.
  int takes = 0;
  {
    Bench whole(made, configure);
    whole.demand();
    whole.masked(contid::HOME);
    while (whole.searching() && takes < 30000) {
      if (takes++ % 5 == 0) whole.demand();
      whole.tick();
    }
    if (whole.faulty() || fault == Fault::NONE) {
      std::printf("%d %d %d 0 0 0\n", whole.reason(), whole.state(), takes);
      return;
    }
  }
  Bench bench(made, configure);
  bench.demand();
  bench.masked(contid::HOME);
  const int at = std::uniform_int_distribution<>(-takes / 8, takes - 1)(random);
  Onset onset;
  for (int ms = 0; ms < 40000 && bench.searching(); ++ms) {
    if (ms == (at < 0 ? 0 : at)) {
      bench.shaft.fail(fault);
      onset.begin(bench);
    }
    if (ms % 5 == 0) bench.demand();
    bench.tick();
    if (bench.shaft.fault != Fault::NONE) onset.look(bench);
  }
  report(bench, onset);
}

// Ten seconds of lines, waves, steps and pauses, and blocks that end before they are a stall.
void healthy(std::mt19937& random, double speed, double play, const Bytes& configure) {
  const auto between = [&](double low, double high) { return std::uniform_real_distribution<>(low, high)(random); };
  Shaft made;
  do {
    made = shafts::within_rating(random, (random() & 1) != 0, play);
  } while (made.capable() < 1.1 * speed);  // the limits of a file are below what its motor can do
  Bench bench(made, configure);
  bench.demand();
  bench.masked(contid::ARM);
  double goal = bench.shaft.count, velocity = 0.0;
  int blocked = 0;
  Onset onset;
  onset.begin(bench);
  while (bench.now() < 10000 && !bench.faulty()) {
    const int kind = std::uniform_int_distribution<>(0, 3)(random);
    Stream stream(speed * std::pow(10.0, between(-2.0, 0.0)), random);
    stream.from = kind == 1 ? goal + between(-1.0, 1.0) * speed : goal;
    const int start = bench.now(), lasts = static_cast<int>(between(50.0, 1500.0));
    if (blocked == 0 && between(0.0, 1.0) < 0.2) blocked = static_cast<int>(between(1.0, 200.0));
    while (bench.now() - start < lasts && !bench.faulty()) {
      if ((bench.now() - start) % 5 == 0) {
        if (kind == 2) stream.at((bench.now() - start) / 1000.0, goal, velocity);
        if (kind == 3) goal = stream.from + stream.speed * (bench.now() - start) / 1000.0, velocity = stream.speed;
        if (kind < 2) goal = stream.from;
        bench.demand(&goal, kind < 2 ? nullptr : &velocity);
      }
      // It is let go before the drive is that of a stall.
      blocked = std::fabs(bench.duty()) < 0.38 && blocked > 0 ? blocked - 1 : 0;
      bench.shaft.blocked = blocked > 0;
      bench.tick();
      onset.look(bench);
    }
    if (kind == 0) bench.run(1);
  }
  report(bench, onset);
}

}  // namespace

int main() {
  std::string line, mode, fault, hex;
  while (std::getline(std::cin, line)) {
    unsigned seed;
    double speed, play;
    std::istringstream(line) >> mode >> fault >> seed >> speed >> play >> hex;
    Bytes configure;
    for (size_t i = 0; i + 1 < hex.size(); i += 2) {
      configure.push_back(static_cast<uint8_t>(std::strtoul(hex.substr(i, 2).c_str(), nullptr, 16)));
    }
    std::mt19937 random(seed);
    const char* const names[] = {"none", "dead", "track_a", "track_b", "reversed"};
    Fault kind = Fault::NONE;
    for (int i = 0; i < 5; ++i) {
      if (fault == names[i]) kind = static_cast<Fault>(i);
    }
    if (mode == "armed") armed(random, kind, speed, play, configure);
    if (mode == "homing") homing(random, kind, speed, play, configure);
    if (mode == "healthy") healthy(random, speed, play, configure);
    std::fflush(stdout);
  }
  return 0;
}

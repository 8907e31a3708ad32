// contid_due_host: the sketch's core on this computer.
//
//   contid_due_host motor|pressure --pty LINK [--reset-on-open]  in real time, on a pty
//   contid_due_host motor|pressure --lockstep                    time moves by command
//
// Both take [--journal FILE] [--world "set ..."] [--adc STEPS MILLIVOLT] [--bridges BITS] [--capabilities BITS], and
// commands on stdin (firmware/host/README.md); the end of stdin ends the program.

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <mutex>
#include <random>
#include <sstream>
#include <string>
#include <thread>

#include "machine.h"

namespace {

using contid::Machine;

std::vector<uint8_t> from_hex(const std::string& text) {
  std::vector<uint8_t> bytes;
  for (size_t i = 0; i + 1 < text.size(); i += 2) {
    bytes.push_back(static_cast<uint8_t>(std::strtoul(text.substr(i, 2).c_str(), nullptr, 16)));
  }
  return bytes;
}

std::string to_hex(const std::vector<uint8_t>& bytes) {
  std::string text;
  char two[3];
  for (uint8_t byte : bytes) {
    std::snprintf(two, sizeof two, "%02x", byte);
    text += two;
  }
  return text;
}

// ---- lockstep ----

// "step N" advances by ticks, "rx HEX" and "rx2 HEX" deliver bytes to the native and the programming port; other lines
// are commands of the machine. Each is answered by "ok" and what the board sent ("-" for nothing).
int run_lockstep(Machine& machine) {
  std::string line;
  std::vector<uint8_t> waiting;
  while (std::getline(std::cin, line)) {
    std::istringstream in(line);
    std::string verb, hex, out;
    std::vector<uint8_t> other;
    in >> verb;
    bool understood = true;
    if (verb == "step") {
      long count = 1;
      in >> count;
      for (long i = 0; i < count; ++i) machine.tick();
    } else if (verb == "rx") {
      in >> hex;
      for (uint8_t byte : from_hex(hex)) waiting.push_back(byte);
    } else if (verb == "rx2") {
      in >> hex;
      for (uint8_t byte : from_hex(hex)) machine.take(byte, other, contid::PortId::PROGRAMMING);
      out = other.empty() ? "-" : to_hex(other);
    } else {
      understood = machine.command(line, out);
    }
    std::vector<uint8_t> reply;
    if (machine.receives()) {
      for (uint8_t byte : waiting) machine.take(byte, reply);
      waiting.clear();
    }
    if (verb == "rx" || !reply.empty()) out = reply.empty() ? "-" : to_hex(reply);
    std::cout << (understood ? "ok " : "what? ") << out << std::endl;
  }
  return 0;
}

// ---- real time ----

uint64_t now_us() {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<uint64_t>(now.tv_sec) * 1000000u + static_cast<uint64_t>(now.tv_nsec) / 1000u;
}

std::atomic<uint64_t> ticked_us(0);  // when the newest tick was due

uint32_t since_tick_us() {
  const uint64_t now = now_us(), ticked = ticked_us;
  return now > ticked ? static_cast<uint32_t>(now - ticked) : 0;
}

class Port {
 public:
  explicit Port(const std::string& link) : link_(link) {}
  ~Port() { unplug(); }

  bool plug() {
    master_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (master_ < 0 || grantpt(master_) != 0 || unlockpt(master_) != 0) return false;
    const char* name = ptsname(master_);
    const int slave = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
    struct termios mode;
    if (slave < 0 || tcgetattr(slave, &mode) != 0) return false;
    cfmakeraw(&mode);
    tcsetattr(slave, TCSANOW, &mode);
    close(slave);
    const std::string fresh = link_ + ".new";
    ::unlink(fresh.c_str());
    // The link changes atomically from the old device to the new one.
    if (symlink(name, fresh.c_str()) != 0 || rename(fresh.c_str(), link_.c_str()) != 0) return false;
    return true;
  }
  void unplug() {
    if (master_ < 0) return;
    ::unlink(link_.c_str());
    close(master_);
    master_ = -1;
  }
  bool plugged() const { return master_ >= 0; }
  int fd() const { return master_; }

 private:
  std::string link_;
  int master_ = -1;
};

struct Shared {
  std::mutex interrupts;  // holding it keeps the tick out, as masking the timer interrupt does
  Machine* machine;
  bool ended = false;
  uint32_t unplugged_ms = 0;
  bool garbage = false;
  bool muted = false;
  contid::PortId port = contid::PortId::NATIVE;
};

void run_ticks(Shared& shared) {
  struct timespec next;
  clock_gettime(CLOCK_MONOTONIC, &next);
  while (true) {
    next.tv_nsec += 1000000;
    if (next.tv_nsec >= 1000000000) {
      next.tv_nsec -= 1000000000;
      ++next.tv_sec;
    }
    // A late tick is caught up at once: board time is wall time.
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, nullptr);
    std::lock_guard<std::mutex> masked(shared.interrupts);
    if (shared.ended) return;
    shared.machine->tick();
    ticked_us = static_cast<uint64_t>(next.tv_sec) * 1000000u + static_cast<uint64_t>(next.tv_nsec) / 1000u;
    if (shared.unplugged_ms > 0 && shared.unplugged_ms != UINT32_MAX) --shared.unplugged_ms;
  }
}

void write_or_drop(Shared& shared, int fd, const std::vector<uint8_t>& reply) {
  // A port that is not read takes nothing: the answer is dropped and counted, loop() goes on.
  if (reply.empty() || shared.muted) return;
  const ssize_t written = write(fd, reply.data(), reply.size());
  if (written != static_cast<ssize_t>(reply.size())) shared.machine->count_dropped();
}

void run_loop(Shared& shared, Port& port, bool reset_on_open) {
  bool open_before = false;
  uint32_t noise = 1;
  while (true) {
    bool want_plugged = false;
    bool receives = false;
    {
      std::lock_guard<std::mutex> masked(shared.interrupts);
      if (shared.ended) return;
      want_plugged = shared.unplugged_ms == 0;
      receives = shared.machine->receives();
    }
    if (!want_plugged && port.plugged()) port.unplug();
    if (want_plugged && !port.plugged() && !port.plug()) std::perror("pty");
    if (!port.plugged() || !receives) {
      usleep(500);
      continue;
    }
    struct pollfd look = {port.fd(), POLLIN, 0};
    poll(&look, 1, 20);
    uint8_t bytes[512];
    const ssize_t count = read(port.fd(), bytes, sizeof bytes);
    // Asked again after the read: bytes of a host that opened the port meanwhile came before the reset, too.
    poll(&look, 1, 0);
    const bool open_now = (look.revents & POLLHUP) == 0;
    const bool opened = open_now && !open_before;
    open_before = open_now;
    if (opened && reset_on_open) {
      std::lock_guard<std::mutex> masked(shared.interrupts);
      shared.machine->reset(contid::ResetCause::PIN);
      tcflush(port.fd(), TCIOFLUSH);
      continue;
    }
    if (!open_now) usleep(500);
    if (count <= 0) continue;
    std::vector<uint8_t> reply;
    std::lock_guard<std::mutex> masked(shared.interrupts);
    for (ssize_t i = 0; i < count; ++i) {
      uint8_t byte = bytes[i];
      if (shared.garbage) {
        // One bit of one byte in sixteen: what a bad cable does to both directions.
        noise = noise * 1664525u + 1013904223u;
        if ((noise >> 28) == 0) byte = static_cast<uint8_t>(byte ^ (1u << ((noise >> 20) & 7u)));
      }
      shared.machine->take(byte, reply, shared.port);
    }
    write_or_drop(shared, port.fd(), reply);
  }
}

void run_commands(Shared& shared) {
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream in(line);
    std::string verb, out;
    in >> verb;
    std::lock_guard<std::mutex> masked(shared.interrupts);
    bool understood = true;
    if (verb == "unplug") {
      if (!(in >> shared.unplugged_ms)) shared.unplugged_ms = UINT32_MAX;
    } else if (verb == "plug") {
      shared.unplugged_ms = 0;
    } else if (verb == "garbage") {
      in >> shared.garbage;
    } else if (verb == "port") {
      std::string name;
      in >> name;
      shared.port = name == "programming" ? contid::PortId::PROGRAMMING : contid::PortId::NATIVE;
    } else if (verb == "mute") {
      in >> shared.muted;
    } else {
      understood = shared.machine->command(line, out);
    }
    std::cout << (understood ? "ok " : "what? ") << out << std::endl;
  }
}

int run_on_pty(Machine& machine, const std::string& link, bool reset_on_open) {
  Shared shared;
  shared.machine = &machine;
  Port port(link);
  if (!port.plug()) {
    std::perror(link.c_str());
    return 1;
  }
  std::cout << "ready" << std::endl;
  std::thread ticks(run_ticks, std::ref(shared));
  std::thread loop(run_loop, std::ref(shared), std::ref(port), reset_on_open);
  run_commands(shared);
  {
    std::lock_guard<std::mutex> masked(shared.interrupts);
    shared.ended = true;
  }
  ticks.join();
  loop.join();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  std::string link, journal = "/dev/null";
  std::vector<std::string> world;  // commands that describe the plant before the board is powered
  bool lockstep = false, reset_on_open = false;
  contid::Parts parts;
  for (int i = 2; i < argc; ++i) {
    const std::string item = argv[i];
    if (item == "--lockstep") lockstep = true;
    if (item == "--reset-on-open") reset_on_open = true;
    if (item == "--world" && i + 1 < argc) world.push_back(argv[++i]);
    if (item == "--adc" && i + 2 < argc) {
      parts.adc_steps = static_cast<uint16_t>(std::atoi(argv[++i]));
      parts.adc_mv = static_cast<uint16_t>(std::atoi(argv[++i]));
    }
    if (item == "--bridges" && i + 1 < argc) parts.bridges = std::atoi(argv[++i]);
    if (item == "--capabilities" && i + 1 < argc) parts.capabilities = std::atoi(argv[++i]);
    if (item == "--pty" && i + 1 < argc) link = argv[++i];
    if (item == "--journal" && i + 1 < argc) journal = argv[++i];
  }
  const bool motor = argc > 1 && std::strcmp(argv[1], "motor") == 0;
  const bool pressure = argc > 1 && std::strcmp(argv[1], "pressure") == 0;
  if ((!motor && !pressure) || (!lockstep && link.empty())) {
    std::fprintf(stderr,
                 "use: contid_due_host motor|pressure --lockstep | --pty LINK [--reset-on-open]"
                 " [--journal FILE] [--world \"set ...\"] [--adc STEPS MILLIVOLT] [--bridges BITS]"
                 " [--capabilities BITS]\n");
    return 2;
  }
  FILE* file = std::fopen(journal.c_str(), "a");
  if (file == nullptr) {
    std::perror(journal.c_str());
    return 1;
  }
  int code = 0;
  {
    const uint32_t boot_id = lockstep ? contid::FIRST_BOOT_ID : static_cast<uint32_t>(std::random_device()());
    static Machine machine(motor ? contid::Role::MOTOR : contid::Role::PRESSURE, file, parts, boot_id,
                           lockstep ? nullptr : since_tick_us);
    for (const std::string& line : world) {
      std::string out;
      if (!machine.command(line, out)) std::fprintf(stderr, "not understood: %s\n", line.c_str());
    }
    code = lockstep ? run_lockstep(machine) : run_on_pty(machine, link, reset_on_open);
  }
  std::fclose(file);
  return code;
}

// C entry points of the core for the Cortex-M3 tests, and the edge interrupt as the Arduino core dispatches it.
// Freestanding: no libc, no Arduino.
#include "../contid_due/src/core/link.h"
#include "../contid_due/src/core/quadrature.h"
#include "../host/identity.h"

namespace {

contid::Board board;
contid::Link link;
contid::Quadrature decoder;
volatile uint32_t port_levels;   // stands for PIOD->PIO_PDSR
volatile uint32_t port_changes;  // stands for PIOD->PIO_ISR

void on_edge() { decoder.edge((port_levels >> 1) & 3u); }

typedef void (*Callback)();
Callback callbacks[32];

}  // namespace

extern "C" {

contid::Inputs m3_inputs;
contid::Outputs m3_outputs;

void m3_start(uint32_t role) {
  board.start(contid::emulated_identity(role == 0 ? contid::Role::MOTOR : contid::Role::PRESSURE), nullptr, nullptr);
  link.start();
  decoder.start(0);
  for (uint32_t i = 0; i < 32; ++i) callbacks[i] = on_edge;
}

void m3_tick() { board.tick(m3_inputs, m3_outputs); }

uint32_t m3_take(uint32_t byte) { return static_cast<uint32_t>(link.take(static_cast<uint8_t>(byte), board)); }

const uint8_t* m3_reply() { return link.reply(); }

// The loop of PIOx_Handler in the Arduino SAM core (WInterrupts.c): every pin of the port is looked at.
void m3_edge(uint32_t levels, uint32_t changed) {
  port_levels = levels;
  port_changes = changed;
  uint32_t flags = port_changes;
  for (uint32_t i = 0; i < 32; ++i, flags >>= 1) {
    if ((flags & 1u) == 0) continue;
    if (callbacks[i] != nullptr) callbacks[i]();
  }
}

int32_t m3_count() { return decoder.count; }

void* memset(void* to, int value, size_t size) {
  volatile uint8_t* bytes = static_cast<uint8_t*>(to);
  for (size_t i = 0; i < size; ++i) bytes[i] = static_cast<uint8_t>(value);
  return to;
}

void* memcpy(void* to, const void* from, size_t size) {
  volatile uint8_t* bytes = static_cast<uint8_t*>(to);
  const uint8_t* source = static_cast<const uint8_t*>(from);
  for (size_t i = 0; i < size; ++i) bytes[i] = source[i];
  return to;
}

}  // extern "C"

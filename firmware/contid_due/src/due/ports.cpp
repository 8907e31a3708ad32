// The programming port (UART) and the native port (USB), both served from loop() without a wait and without an
// interrupt of their own.
//
// The UART moves bytes by its DMA controller: its receiver has no FIFO, and an interrupt that waits for the tick
// would lose every byte that arrives meanwhile (one in 40 us). The core's SerialUSB is used for enumeration and line
// state only: its accept() can release a bank that it has not read, when packets follow each other closely.
#ifdef ARDUINO_ARCH_SAM

#include "ports.h"

#include <Arduino.h>

#include "../port.h"

namespace contid {

namespace {

const uint32_t BAUD = 250000;  // exact on both chips of the programming port

// ---- native port ----

Port native;
uint8_t packet[512];
size_t packet_size, packet_at;

volatile uint8_t* usb_bank(uint32_t endpoint) {
  return reinterpret_cast<volatile uint8_t*>(UOTGHS_RAM_ADDR + 0x8000u * endpoint);
}

bool native_has_room() { return SerialUSB.dtr() && (UOTGHS->UOTGHS_DEVEPTISR[CDC_TX] & UOTGHS_DEVEPTISR_TXINI) != 0; }

void send_packet(const uint8_t* data, size_t size) {
  volatile uint8_t* const bank = usb_bank(CDC_TX);
  for (size_t i = 0; i < size; ++i) bank[i] = data[i];
  UOTGHS->UOTGHS_DEVEPTICR[CDC_TX] = UOTGHS_DEVEPTICR_TXINIC;
  UOTGHS->UOTGHS_DEVEPTIDR[CDC_TX] = UOTGHS_DEVEPTIDR_FIFOCONC;
}

// A packet of a full-speed link (hubs, isolators) holds 64 bytes. The last packet of an answer is shorter than
// that: a full one would leave the host waiting for more.
size_t packet_of(size_t left) {
  const uint32_t speed = UOTGHS->UOTGHS_SR & UOTGHS_SR_SPEED_Msk;
  const size_t most = speed == UOTGHS_SR_SPEED_HIGH_SPEED ? 512 : 64;
  if (left < most) return left;
  return left == most ? most - 1 : most;
}

void receive_packet() {
  if ((UOTGHS->UOTGHS_DEVEPTIMR[CDC_RX] & UOTGHS_DEVEPTIMR_RXOUTE) != 0) {
    UOTGHS->UOTGHS_DEVEPTIDR[CDC_RX] = UOTGHS_DEVEPTIDR_RXOUTEC;
  }
  if (packet_at < packet_size || (UOTGHS->UOTGHS_DEVEPTISR[CDC_RX] & UOTGHS_DEVEPTISR_RXOUTI) == 0) return;
  UOTGHS->UOTGHS_DEVEPTICR[CDC_RX] = UOTGHS_DEVEPTICR_RXOUTIC;
  const size_t size = (UOTGHS->UOTGHS_DEVEPTISR[CDC_RX] & UOTGHS_DEVEPTISR_BYCT_Msk) >> UOTGHS_DEVEPTISR_BYCT_Pos;
  const volatile uint8_t* const bank = usb_bank(CDC_RX);
  packet_size = size < sizeof(packet) ? size : sizeof(packet);
  packet_at = 0;
  for (size_t i = 0; i < packet_size; ++i) packet[i] = bank[i];
  UOTGHS->UOTGHS_DEVEPTIDR[CDC_RX] = UOTGHS_DEVEPTIDR_FIFOCONC;
}

void serve_native(Board& board) {
  if (native.torn && native_has_room()) {
    const uint8_t end = 0;
    send_packet(&end, 1);
    native.torn = false;
  }
  if (native.left > 0 && !native.torn && native_has_room()) {
    const size_t size = packet_of(native.left);
    send_packet(native.waiting, size);
    native.took(size);
  }
  native.drop_overdue(board);
  receive_packet();
  while (native.left == 0 && packet_at < packet_size) native.take(packet[packet_at++], board);
}

// ---- programming port ----

const uint32_t HALF = 256;  // 10 ms of bytes
Link programming;
uint8_t ring[2 * HALF];  // written by the DMA controller, half by half
uint32_t tail;

uint32_t address_of(const uint8_t* data) { return static_cast<uint32_t>(reinterpret_cast<uintptr_t>(data)); }

uint32_t head() { return (UART->UART_RPR - address_of(ring)) % (2 * HALF); }

// Gives the controller the half behind the one that it fills, once that is read.
void rearm() {
  if (UART->UART_RNCR != 0) return;
  const uint32_t at = head();
  const bool stopped = UART->UART_RCR == 0;
  const uint32_t next = stopped ? at : (at / HALF * HALF + HALF) % (2 * HALF);
  if (tail / HALF == next / HALF && tail != at) return;
  if (stopped) {
    UART->UART_RPR = address_of(ring) + next;
    UART->UART_RCR = HALF;
  } else {
    UART->UART_RNPR = address_of(ring) + next;
    UART->UART_RNCR = HALF;
  }
}

void start_programming() {
  pmc_enable_periph_clk(ID_UART);
  UART->UART_PTCR = UART_PTCR_RXTDIS | UART_PTCR_TXTDIS;
  UART->UART_CR = UART_CR_RSTRX | UART_CR_RSTTX | UART_CR_RXDIS | UART_CR_TXDIS;
  UART->UART_MR = UART_MR_PAR_NO;
  UART->UART_BRGR = VARIANT_MCK / 16 / BAUD;
  UART->UART_IDR = 0xFFFFFFFFu;
  programming.start(PortId::PROGRAMMING);
  tail = 0;
  UART->UART_RPR = address_of(ring);
  UART->UART_RCR = HALF;
  UART->UART_RNPR = address_of(ring) + HALF;
  UART->UART_RNCR = HALF;
  UART->UART_TCR = 0;
  UART->UART_TNCR = 0;
  UART->UART_PTCR = UART_PTCR_RXTEN | UART_PTCR_TXTEN;
  UART->UART_CR = UART_CR_RXEN | UART_CR_TXEN;
}

void serve_programming(Board& board) {
  rearm();
  if ((UART->UART_SR & UART_SR_OVRE) != 0) UART->UART_CR = UART_CR_RSTSTA;
  // The answer before is read from the link's buffer until it is sent.
  while (UART->UART_TCR == 0 && tail != head()) {
    const size_t size = programming.take(ring[tail], board);
    tail = (tail + 1) % (2 * HALF);
    if (size == 0) continue;
    UART->UART_TPR = address_of(programming.reply());
    UART->UART_TCR = static_cast<uint32_t>(size);
  }
}

}  // namespace

void start_ports() {
  native.start();
  packet_size = 0;
  packet_at = 0;
  start_programming();
}

void serve_ports(Board& board) {
  serve_native(board);
  serve_programming(board);
}

}  // namespace contid

#endif  // ARDUINO_ARCH_SAM

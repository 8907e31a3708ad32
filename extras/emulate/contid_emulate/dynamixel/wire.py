"""The wire of an emulated bus: a pseudo terminal that paces answers like a serial line.

A pty transfers at once at any baud rate, so the time of every byte is computed here: an instruction ends
after the time of its bytes, an answer is written when its last byte would have arrived, a fast one part by
part. The rate is the one set by the host; servos with another rate receive nothing.
"""

from __future__ import annotations

import heapq
import math
import select
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from contid_driverkit.control_file import ControlFile
from contid_driverkit.pseudo_port import PseudoPort
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import BROADCAST, Instruction, Packet, build, read_parameters, take
from contid_emulate.dynamixel.faults import FaultSwitches, InjectedFault
from contid_emulate.dynamixel.replies import addressed, answers, misreadings
from contid_emulate.dynamixel.servo import Servo
from contid_emulate.dynamixel.tendons import TendonPlant

#: The last part of a wait is spent spinning, because a sleep is late by about as much.
SPIN_S: Final = 120e-6
#: Interval at which idle servos and their watchdogs are advanced.
IDLE_S: Final = 0.01
BITS_PER_BYTE: Final = 10


class DynamixelEmulator:
    """A bus of emulated servos on a pty, served by a thread between `start` and `stop`.

    Args:
        servos: the servos.
        port: symbolic link to the pty, None for the pty's own name.
        control: file of fault switches.
        paced: False answers without delay, for tests that do not depend on time.
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        port: Path | str | None = None,
        control: Path | None = None,
        paced: bool = True,
    ) -> None:
        self.servos = tuple(servos)
        #: Tendons on the spools of servos, one plant per robot.
        self.tendons: tuple[TendonPlant, ...] = ()
        self.faults = FaultSwitches()

        self._port = PseudoPort(port)
        self._control = ControlFile(control, self._switch) if control is not None else None
        self._paced = paced
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._received = bytearray()
        self._due: list[tuple[float, int, bytes]] = []
        self._sent = 0
        self._line_free = 0.0
        self._second_host_at = 0.0
        self.instructions = 0

    # -- life ----------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Create the pty and serve it."""
        now = time.monotonic()
        for servo in self.servos:
            servo.now = servo.booted_at = servo.fed_at = now
        self._plug()
        self._stop.clear()
        self._thread = threading.Thread(target=self._serve, name="dynamixel-emulator", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and remove the port."""
        if self._thread is None:
            return
        self._stop.set()
        self._thread.join()
        self._thread = None
        self._port.unplug()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.stop()

    @property
    def port(self) -> str:
        """Path a host opens."""
        return self._port.name

    def servo(self, device: int) -> Servo:
        """The (first) servo with an id, advanced to now."""
        with self._lock:
            servo = next(each for each in self.servos if each.device == device)
            servo.advance(time.monotonic())
            return servo

    def shafts(self, now_s: float) -> list[float]:
        """True positions of the servos [ticks], advanced to a time."""
        with self._lock:
            for servo in self.servos:
                servo.advance(now_s)
            return [servo.motion.position for servo in self.servos]

    def set(self, kind: str, device: int | None = None, **values: object) -> None:
        """Set a fault switch by the keys of a control file."""
        with self._lock:
            self._switch({"fault": kind, "id": device, **values})

    def _switch(self, given: object) -> None:
        fault = InjectedFault.model_validate(given)
        if self.faults.set(fault):
            return
        if fault.kind == "unplug":
            self._port.unplug()
        elif fault.kind == "replug":
            self._port.unplug()
            self._plug(fault.port)
        elif fault.kind in ("snap", "tube"):
            self._set_tendons(fault)
        now = time.monotonic()
        for servo in self.servos:
            if fault.device is not None and servo.device != fault.device:
                continue
            servo.advance(now)
            if fault.kind in ("alert", "overload"):
                servo.fail(fault.bits if fault.kind == "alert" else 0x20)
            elif fault.kind == "brownout":
                servo.reboot()
            elif fault.kind == "trip":
                servo.trip()
            elif fault.kind == "jam":
                servo.jam(fault.on)
            elif fault.kind == "push":
                servo.push(math.radians(fault.degrees) / reg.RAD_PER_TICK, fault.ms / 1e3)
            elif fault.kind == "share":
                servo.motion.see(fault.share)
            elif fault.kind == "jump":
                servo.motion.jumped += math.radians(fault.degrees) / reg.RAD_PER_TICK
            elif fault.kind == "slow":
                servo.motion.slowed = fault.share
            elif fault.kind == "freeze":
                servo.frozen = servo.present() if fault.on else None

    def _set_tendons(self, fault: InjectedFault) -> None:
        for plant in self.tendons:
            if fault.kind == "tube":
                plant.held = fault.on
            elif fault.device in plant.devices:
                plant.snap(plant.devices.index(fault.device), fault.on)

    # -- serving -------------------------------------------------------------------------------------------

    def _plug(self, link: str | None = None) -> None:
        self._port.plug(link)
        self._received.clear()
        self._due.clear()

    def _byte_s(self) -> tuple[int, float]:
        rate = self._port.rate()
        return rate, BITS_PER_BYTE / rate if rate and self._paced else 0.0

    def _serve(self) -> None:
        looked, turned = 0.0, time.monotonic()
        while not self._stop.is_set():
            with self._lock:
                watched = [self._port.descriptor] if self._port.plugged else []
                until = self._due[0][0] if self._due else None
            now = time.monotonic()
            wait = IDLE_S if until is None else max(0.0, until - now - SPIN_S)
            if self.faults.second_host_hz:
                wait = min(wait, max(0.0, self._second_host_at - now))
            ready, _, _ = select.select(watched, [], [], min(wait, IDLE_S))
            with self._lock:
                turned, before = time.monotonic(), turned
                self._excuse(turned - before - IDLE_S)
                if self._port.plugged and self._port.descriptor in ready:
                    self._receive()
                if self.faults.second_host_hz and self._port.plugged and now >= self._second_host_at:
                    self._second_host()
                self._deliver()
                if not self._due and time.monotonic() - looked >= IDLE_S:
                    self._idle()
                    looked = time.monotonic()

    def _excuse(self, stalled_s: float) -> None:
        """Leave time in which this process did not run out of the watchdogs of its servos.

        What was sent meanwhile waits in the pty; a real servo would have been fed by it.
        """
        if stalled_s > IDLE_S:
            for servo in self.servos:
                servo.fed_at += stalled_s

    def _idle(self) -> None:
        now = time.monotonic()
        for servo in self.servos:
            servo.advance(now)
        if self._control is not None:
            self._control.poll()

    def _receive(self) -> None:
        chunk = self._port.read()
        if not chunk:
            return
        now = time.monotonic()
        rate, byte_s = self._byte_s()
        self._line_free = max(self._line_free, now) if byte_s else now
        if self.faults.echo:
            self._schedule(self._line_free + len(chunk) * byte_s, chunk, byte_s)
        self._received += chunk
        while (packet := take(self._received)) is not None:
            self._line_free += len(packet.wire) * byte_s
            self._answer(packet, now, rate, byte_s)

    def _answer(self, packet: Packet, now: float, rate: int, byte_s: float) -> None:
        self.instructions += 1
        receiving = []
        ids = addressed(packet)
        for servo in self.servos:
            if servo.baud == rate and servo.device not in self.faults.silent:
                servo.advance(now)
                if servo.answers:
                    if servo.device in ids:
                        servo.feed(now)
                    receiving.append(servo)
        end = self._line_free
        # A damaged instruction to several servos is not answered; "drop" and "silent" are like it.
        misread = packet.device != BROADCAST and self.faults.spent("misread", packet.device)
        act = misreadings if misread else answers
        for answer in act(packet, receiving, byte_s):
            device, wire = answer.device, answer.wire
            at = end + answer.at_s
            self._line_free = max(self._line_free, at)
            if self.faults.spent("drop", device):
                continue
            if self.faults.spent("corrupt", device):
                # A bit near the end, so that header, id and length stay intact.
                wire = wire[:-3] + bytes((wire[-3] ^ 0x10,)) + wire[-2:]
            late = self.faults.delay_s.get(device, 0.0)
            self._schedule(at + late, wire, byte_s, answer.ends)
            if self.faults.spent("duplicate", device):
                self._schedule(at + late + len(wire) * byte_s, wire, byte_s)

    def _schedule(self, at: float, wire: bytes, byte_s: float, ends: tuple[int, ...] = ()) -> None:
        for arrival, piece in self.faults.adapter.arrivals(at, wire, byte_s, ends):
            self._sent += 1
            heapq.heappush(self._due, (arrival, self._sent, piece))

    def _second_host(self) -> None:
        """Another host reads a position: this host receives request and answer as well.

        It does not wait for a free line: a transmission under way is broken by it.
        """
        self._second_host_at = time.monotonic() + 1.0 / self.faults.second_host_hz
        now = time.monotonic()
        rate, byte_s = self._byte_s()
        if now < self._line_free:
            self._due = [(at, i, bytes(a & 0x5A for a in wire)) for at, i, wire in self._due]
            heapq.heapify(self._due)
            return
        device = self.servos[self.instructions % len(self.servos)].device
        parameters = read_parameters(reg.PRESENT_POSITION.address, 4)
        wire = build(device, Instruction.READ, parameters)
        self._line_free = now + len(wire) * byte_s
        self._schedule(self._line_free, wire, byte_s)
        self._answer(Packet(device, Instruction.READ, 0, parameters, wire), now, rate, byte_s)

    def _deliver(self) -> None:
        """Write the answers that are due."""
        while self._due and self._port.plugged:
            at, _, wire = self._due[0]
            left = at - time.monotonic()
            if left > SPIN_S:
                break
            while self._paced and time.monotonic() < at:
                pass
            heapq.heappop(self._due)
            self._port.write(wire)

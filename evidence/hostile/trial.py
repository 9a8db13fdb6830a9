"""Sends a device of its own mutated requests and datagrams, and measures what they do to the device."""

from __future__ import annotations

import random
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from rich.progress import Progress

from dtwin.errors import CommunicationError, DtwinError, ParameterError
from evidence.hostile.inputs import DATAGRAMS, TARGETS, Inputs
from evidence.served import ServedDevice
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import REQUESTS, RESPONSES, ManagedBlock, parse_response
from iec61499.net.address import LOOPBACK, Address, StreamAddress
from iec61499.net.client import BlockingClient
from iec61499.net.sockets import connected_socket
from iec61499.net.wire import Signature
from iec61499.types import UINT

PERIOD: Final = 0.01
"""Time between two ticks of the resource that must not be disturbed, s."""
TIMEOUT: Final = 20.0
SO_TIMESTAMPNS: Final = 35
"""Option of a Linux socket that Python has no name for."""
REBUILT: Final = 500
"""Inputs after which the targets are built anew, since some of the inputs kill them."""
WARM_UP: Final = 0.05
"""Part of the inputs before memory is measured first: types are compiled when they are used first."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a trial has shown.

    Attributes:
        requests: how many requests were sent.
        answered: how many of them had an answer.
        datagrams: how many datagrams were sent.
        latest: longest time that a tick of another resource was late, s.
        undisturbed: the same of a device that nobody sent anything, s: what the machine does to both.
        ticks: how many ticks were seen.
        growth: by how much the memory of the device has grown, bytes.
        lines: lines in the log of the device.
        duration: s.
    """

    requests: int
    answered: int
    datagrams: int
    latest: float
    undisturbed: float
    ticks: int
    growth: int
    lines: int
    duration: float


def fuzz(requests: int, datagrams: int, seed: int, log: Path, progress: Callable[[int], None]) -> Outcome:
    """Runs a trial on a device of its own.

    Args:
        requests: how many requests are sent.
        datagrams: how many datagrams are sent.
        seed: number of the random generator of the inputs.
        log: file for the log of the device.
        progress: called with the number of inputs sent so far.

    Raises:
        DtwinError: the device has ended, or does not answer.
    """
    with (
        log.open("w") as errors,
        ServedDevice(errors, "--listen", f"{LOOPBACK}:0") as device,
        ServedDevice(errors, "--listen", f"{LOOPBACK}:0") as other,
    ):
        trial = _Trial(device, random.Random(seed))
        outcome = trial.run(other, requests, datagrams, progress)
    lines = log.read_text(errors="replace").count("\n")
    return Outcome(*outcome[:7], lines, outcome[7])


class _Ticks:
    """Receives the ticks of the resource that must not be disturbed, each with its number."""

    def __init__(self, device: ServedDevice) -> None:
        self.offsets: list[float] = []
        self._signature = Signature([UINT])
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((LOOPBACK, 0))
        self._socket.settimeout(0.5)
        # the kernel says when a datagram was sent, which this process may read much later
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._ended = False
        self._thread = threading.Thread(target=self._receive, daemon=True)
        _build_ticks(device.address, Address(*self._socket.getsockname()))

    def __enter__(self) -> _Ticks:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join(TIMEOUT)
        self._socket.close()

    def _receive(self) -> None:
        turns, before = 0, 0
        while not self._ended:
            try:
                data, notes, _, _ = self._socket.recvmsg(64, 256)
            except TimeoutError:
                continue
            seconds, nanoseconds = struct.unpack("qq", notes[0][2])
            number = self._signature.decode(data)[0]
            turns += number < before
            before = number
            self.offsets.append(seconds + nanoseconds / 1e9 - PERIOD * (number + turns * 65536))

    def latest(self) -> float:
        """Longest time that a tick came after its time, which the earliest of them gives, s."""
        return max(self.offsets) - min(self.offsets) if self.offsets else float("inf")


class _Trial:
    def __init__(self, device: ServedDevice, generator: random.Random) -> None:
        self._device = device
        self._process = device.process
        self._address = device.address
        self._inputs = Inputs(generator)
        self._random = generator
        self._ports = [_free_port() for _ in DATAGRAMS]
        self._answered = 0

    def run(
        self, other: ServedDevice, requests: int, datagrams: int, progress: Callable[[int], None]
    ) -> tuple[int, int, int, float, float, int, int, float]:
        began = time.monotonic()
        total = requests + datagrams
        memory = 0
        with (
            _Ticks(self._device) as ticks,
            _Ticks(other) as others,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            client = self._client()
            for number in range(total):
                if number % REBUILT == 0:
                    client.close()
                    self._build_targets()
                    client = self._client()
                    progress(number)
                if number == int(WARM_UP * total):
                    memory = self._device.memory()
                    ticks.offsets.clear()
                    others.offsets.clear()
                # the datagrams are spread evenly among the requests
                if (number + 1) * datagrams // total > number * datagrams // total:
                    kind, data = self._inputs.datagram()
                    sender.sendto(data[:60_000], (LOOPBACK, self._ports[kind]))
                else:
                    client = self._ask(client)
            client.close()
            growth = self._device.memory() - memory
            latest, undisturbed, count = ticks.latest(), others.latest(), len(ticks.offsets)
        return requests, self._answered, datagrams, latest, undisturbed, count, growth, time.monotonic() - began

    def _client(self) -> BlockingClient:
        return BlockingClient(self._address, REQUESTS, RESPONSES, TIMEOUT)

    def _ask(self, client: BlockingClient) -> BlockingClient:
        """Sends one request, now and then with its frame damaged; that one may cost the connection."""
        resource, text = self._inputs.request()
        if self._random.random() < 0.01:
            client.close()
            with connected_socket(self._address, TIMEOUT) as peer:
                frame = REQUESTS.encode([resource.decode("latin-1"), text.decode("latin-1")])
                peer.sendall(self._inputs.damaged(frame)[:-1] + b"\xee")
            self._answered += 1
            return self._client()
        try:
            answer = client.exchange([resource.decode("latin-1"), text.decode("latin-1")])[0]
            parse_response(answer.encode("latin-1").decode("utf-8", "replace"))
        except CommunicationError as error:
            if self._process.poll() is not None:
                raise DtwinError(f"the device has ended with {self._process.returncode} after {text!r}") from None
            raise DtwinError(f"no answer to {resource!r} {text!r}: {error}") from None
        self._answered += 1
        return client

    def _build_targets(self) -> None:
        with ManagementClient(self._address, TIMEOUT) as client:
            there = [block.name for block in client.blocks("")]
            for name in (*TARGETS, "NONE"):
                if name in there:
                    client.request("", "KILL", ManagedBlock(name, ""))
                    client.delete_block("", name)
            blocks = {f"U{k}": f"SUBSCRIBE_{len(types)}" for k, types in enumerate(DATAGRAMS)}
            blocks |= {"F0": "F_STRING_TO_INT", "F1": "F_STRING_TO_TIME", "F2": "F_LEN", "D": "E_DELAY", "M": "F_MUL"}
            values = {f"U{k}.QI": "1" for k in range(len(DATAGRAMS))}
            values |= {f"U{k}.ID": f'"{LOOPBACK}:{port}"' for k, port in enumerate(self._ports)}
            wires = ", ".join(f"START.COLD U{k}.INIT" for k in range(len(DATAGRAMS)))
            wires += ", U0.IND F0.REQ, U0.RD_1 F0.IN, U0.IND F1.REQ, U0.RD_1 F1.IN, F1.CNF D.START, F1.OUT D.DT"
            wires += ", U1.IND F2.REQ, U1.RD_1 F2.IN, U2.IND M.REQ, U2.RD_1 M.IN1, U2.RD_1 M.IN2"
            _build(client, "T", blocks, values, wires)
            _build(client, "U", {"A": "E_CTU", "B": "E_CYCLE"}, {"B.DT": "T#1ms"}, "START.COLD B.START, B.EO A.CU")


def _build_ticks(device: StreamAddress, receiver: Address) -> None:
    with ManagementClient(device, TIMEOUT) as client:
        _build(
            client,
            "TICK",
            {"C": "E_CYCLE", "N": "E_CTU", "P": "PUBLISH_1", "R": "E_SWITCH"},
            {"C.DT": "T#10ms", "P.QI": "1", "P.ID": f'"{receiver}"', "N.PV": "65535"},
            "START.COLD P.INIT, P.INITO C.START, C.EO N.CU, N.CUO P.REQ, N.CV P.SD_1, N.Q R.G, P.CNF R.EI, R.EO1 N.R",
        )


def _build(client: ManagementClient, name: str, blocks: dict[str, str], values: dict[str, str], wires: str) -> None:
    client.create_block("", name, "EMB_RES")
    for block, kind in blocks.items():
        client.create_block(name, block, kind)
    for port, literal in values.items():
        client.write(name, port, literal)
    for wire in wires.split(", "):
        client.connect(name, *wire.split())
    client.start(name)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        port: int = probe.getsockname()[1]
    return port


@dataclass(frozen=True)
class FbFuzz:
    """Send a device of its own mutated management requests and datagrams, and measure what they do to it.

    The device must answer every request and stay alive. The exit status is 1 if a tick of another resource
    came more than 50 ms later than those of a device that nobody troubles, memory grew by more than 20 MB or the log
    has more than 100 lines.
    """

    requests: int = 200_000
    """Number of management requests."""
    datagrams: int = 100_000
    """Number of datagrams."""
    seed: int = 1
    """Number of the random generator of the inputs."""
    log: Path | None = None
    """File for the log of the device; without it the log is counted and forgotten."""

    def execute(self) -> int:
        if self.requests < 1 or self.datagrams < 0:
            raise ParameterError("--requests and --datagrams: expected at least 1 and 0")
        total = self.requests + self.datagrams
        with TemporaryDirectory() as folder, Progress() as bar:
            task = bar.add_task("inputs", total=total)
            log = self.log or Path(folder) / "device.log"
            outcome = fuzz(self.requests, self.datagrams, self.seed, log, lambda n: bar.update(task, completed=n))
            bar.update(task, completed=total)
        print(f"requests          {outcome.requests}, {outcome.answered} answered")
        print(f"datagrams         {outcome.datagrams}")
        print(f"latest tick       {outcome.latest * 1000:.1f} ms late, of {outcome.ticks} ticks")
        print(
            f"undisturbed       {outcome.undisturbed * 1000:.1f} ms late, the ticks of a device that nobody troubles"
        )
        print(f"memory            {outcome.growth / 1e6:+.1f} MB")
        print(f"log               {outcome.lines} lines")
        print(f"time              {outcome.duration:.0f} s")
        return int(outcome.latest - outcome.undisturbed > 0.05 or outcome.growth > 20e6 or outcome.lines > 100)

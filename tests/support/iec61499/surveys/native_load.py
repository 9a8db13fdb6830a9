"""How late the cycles of a device with many blocks end: `fb run --native` and a 4diac FORTE on the same boot file.

A cycle goes through all blocks, one after the other, and ends with a datagram, which the kernel stamps as it is sent.
The cycle n is due at a time t0 + n DT, where t0 is such that the earliest one is not late at all.
"""

from __future__ import annotations

import os
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import tyro

from tests.support.ports import free_port

_STAMP: Final = struct.Struct("qq")
_TIMESTAMPNS: Final = 35
"""SO_TIMESTAMPNS of Linux, which the module socket does not name."""
FIRST: Final = 600.0
"""Longest time to the first datagram, s: the blocks are compiled before."""
PRIORITY: Final = 10
"""Priority of the devices with --realtime."""
SETTLING: Final = 1.0
"""Time after the first datagram that is not looked at, s."""


@dataclass(frozen=True)
class Options:
    """Measure how late cycles through many blocks end, in machine code and on a 4diac FORTE, one after the other."""

    blocks: int = 5000
    """Blocks that every cycle goes through."""
    cycle: float = 1.0
    """Time between two cycles, ms."""
    seconds: float = 10.0
    """Time that is looked at, s, of each device in each round."""
    rounds: int = 1
    """Rounds in which both have their turn."""
    realtime: bool = False
    """Let the devices go before all other processes (SCHED_FIFO, which needs the right to it), as on a machine of
    their own."""
    forte: Path | None = None
    """The program of a 4diac FORTE with UDP and the blocks of the standard; without it FORTE of the environment."""


@dataclass(frozen=True)
class Measured:
    """What came of one device in one round.

    Attributes:
        late: how late each cycle ended, ms.
        due: cycles that were due.
        load: share of a core that the device took.
    """

    late: Sequence[float]
    due: int
    load: float

    def row(self) -> str:
        """Cycles, and the median, 99th percentile and largest of how late they were, ms."""
        cuts = statistics.quantiles(self.late, n=100, method="inclusive")
        figures = f"{cuts[49]:.3f} | {cuts[98]:.3f} | {max(self.late):.3f}"
        return f"{len(self.late)} of {self.due} | {figures} | {100 * self.load:.0f} %"


def boot_file(blocks: int, cycle: float, port: int) -> str:
    """A resource whose cycle goes through blocks E_T_FF and ends with a datagram of its number."""
    requests = ['<Request ID="1" Action="CREATE"><FB Name="LOAD" Type="EMB_RES" /></Request>']

    def ask(action: str, subject: str) -> None:
        requests.append(f'<Request ID="{len(requests) + 1}" Action="{action}">{subject}</Request>')

    def create(name: str, kind: str) -> None:
        ask("CREATE", f'<FB Name="{name}" Type="{kind}" />')

    def link(action: str, source: str, destination: str) -> None:
        ask(action, f'<Connection Source="{source}" Destination="{destination}" />')

    create("CYCLE", "E_CYCLE")
    link("WRITE", f"T#{cycle:g}ms", "CYCLE.DT")
    create("COUNT", "E_CTU")
    create("TELL", "PUBLISH_1")
    link("WRITE", "1", "TELL.QI")
    link("WRITE", f"127.0.0.1:{port}", "TELL.ID")
    link("CREATE", "COUNT.CV", "TELL.SD_1")
    link("CREATE", "START.COLD", "TELL.INIT")
    link("CREATE", "TELL.INITO", "CYCLE.START")
    before = "CYCLE.EO"
    for number in range(blocks):
        create(f"B{number}", "E_T_FF")
        link("CREATE", before, f"B{number}.CLK")
        before = f"B{number}.EO"
    link("CREATE", before, "COUNT.CU")
    link("CREATE", "COUNT.CUO", "TELL.REQ")
    ask("START", "")
    lines = [f";{requests[0]}", *(f"LOAD;{request}" for request in requests[1:])]
    return "\n".join(lines).replace('Action="START"></Request>', 'Action="START"/>') + "\n"


@contextmanager
def running(command: Sequence[str], folder: Path, realtime: bool) -> Iterator[subprocess.Popen[bytes]]:
    """A device as a process, which ends with the block."""
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder, restore_signals=False)
        try:
            if realtime:
                os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
            yield process
        finally:
            process.kill()
            process.wait()


def processor_time(process: int) -> float:
    """What a process has computed so far, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def stamps(listener: socket.socket, seconds: float) -> Iterator[tuple[int, int]]:
    """Number and time (ns) of each datagram until a time has passed; a number is the last two bytes."""
    end = time.monotonic() + seconds
    while (rest := end - time.monotonic()) > 0:
        listener.settimeout(rest)
        try:
            data, extra, _, _ = listener.recvmsg(64, 256)
        except TimeoutError:
            return
        whole, part = _STAMP.unpack(extra[0][2][: _STAMP.size])
        yield int.from_bytes(data[-2:], "big"), whole * 1_000_000_000 + part


def measured(command: Sequence[str], listener: socket.socket, folder: Path, options: Options) -> Measured:
    """What comes of a device that a command starts. Raises TimeoutError when it tells nothing."""
    with running(command, folder, options.realtime) as process:
        listener.settimeout(FIRST)
        listener.recv(64)
        for _ in stamps(listener, SETTLING):
            pass
        before, began = processor_time(process.pid), time.monotonic()
        found = list(stamps(listener, options.seconds))
        passed = time.monotonic() - began
        load = (processor_time(process.pid) - before) / passed
    ends = [at - number * options.cycle * 1e6 for number, at in found]
    first = min(ends)
    return Measured([(end - first) / 1e6 for end in ends], round(1000 * passed / options.cycle), load)


def main() -> int:
    """Prints a table."""
    options = tyro.cli(Options)
    forte = options.forte or (Path(os.environ["FORTE"]) if os.environ.get("FORTE") else None)
    with tempfile.TemporaryDirectory() as kept, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        folder = Path(kept)
        listener.setsockopt(socket.SOL_SOCKET, _TIMESTAMPNS, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        listener.bind(("127.0.0.1", 0))
        file = folder / "load.fboot"
        file.write_text(boot_file(options.blocks, options.cycle, listener.getsockname()[1]))
        own = [sys.executable, "-m", "dtwin", "fb", "run", "--native", "--listen", "127.0.0.1:0", str(file)]
        commands = {"fb run --native": own}
        if forte is not None:
            commands["4diac FORTE"] = [str(forte), "-c", f"localhost:{free_port()}", "-f", str(file)]
        first = "; the devices go before all others (SCHED_FIFO)" if options.realtime else ""
        print(f"{options.blocks} blocks a cycle of {options.cycle:g} ms; load {os.getloadavg()[0]:.1f}{first}")
        print("| device | cycles | median late, ms | 99 % | largest | of a core |")
        print("| --- " * 6 + "|")
        for _ in range(options.rounds):
            for name, command in commands.items():
                print(f"| {name} | {measured(command, listener, folder, options).row()} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Runs a whole cell for long, disturbs it, and prints what came of it; exit status 1 when a promise was not kept."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dtwin.bus.messages import (
    EVENTS,
    SUMMARY,
    BoxCounts,
    Summary,
)
from dtwin.run.recording import read_log
from dtwin.signals import Event
from services.runfile import join
from services.service import free_port

ROOT = Path(__file__).resolve().parent.parent
LATE_SHARE, P50, P99 = 0.001, 1.5, 5.0
"""promised: share of late ticks; ms"""


def main() -> int:
    runs = {"latency": latency, "chaos": chaos}
    if len(sys.argv) not in (2, 3) or sys.argv[1] not in runs:
        print("usage: scripts/soak latency [SECONDS] | chaos", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        return runs[sys.argv[1]](Path(folder))


def latency(folder: Path) -> int:
    """All services in real time."""
    seconds = sys.argv[2] if len(sys.argv) == 3 else "600"
    words = ["up", "--duration", seconds, "--seed", "1", "--json"]
    words += ["--log", str(folder / "run.parquet"), "--record", str(folder / "run.rrd")]
    found = json.loads(
        subprocess.run([sys.executable, "-m", "dtwin", *words], cwd=ROOT, stdout=-1, check=True).stdout
    )
    late = found["late_ticks"] / found["ticks"]
    figures = found["latency_ms"] | {"late_share": late, "boxes": found["boxes"]}
    print(json.dumps(figures, indent=1))
    return 0 if late <= LATE_SHARE and figures["p50"] <= P50 and figures["p99"] <= P99 else 1


class Proxy:
    """Passes TCP on to a port; while it is cut nothing passes, and no end is told."""

    def __init__(self, target: int) -> None:
        self.cut = threading.Event()
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            near, _ = self._listener.accept()
            try:
                far = socket.create_connection(("127.0.0.1", self._target))
            except OSError:
                near.close()
                continue
            for source, sink in ((near, far), (far, near)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                while self.cut.is_set():
                    time.sleep(0.01)
                sink.sendall(data)
        except OSError:
            pass
        for end in (source, sink):
            end.close()


class Cell:
    """A cell behind a router, the bridge behind a proxy, and what the bus says of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        port = free_port()
        self.proxy = Proxy(port)
        for name, old, new in (
            ("router", "0.0.0.0:7447", f"127.0.0.1:{port}"),
            ("service", "127.0.0.1:7447", f"127.0.0.1:{port}"),
            ("bridge", "127.0.0.1:7447", f"127.0.0.1:{self.proxy.port}"),
        ):
            source = ROOT / "config" / "routed" / f"{'router' if name == 'router' else 'service'}.json5"
            (folder / f"{name}.json5").write_text(source.read_text().replace(old, new))
        self.start_router()
        words = ["up", "--detach", "--zenoh", str(folder), "--log", str(folder / "run.parquet")]
        subprocess.run([sys.executable, "-m", "dtwin", *words], cwd=ROOT, check=True)
        self.bus = join("cell")
        self.events: list[Event] = []
        self.bus.subscribe(EVENTS, Event, self.events.append)

    def start_router(self) -> None:
        self.router = subprocess.Popen(
            [sys.executable, "-m", "services.router", "--zenoh", str(self.folder)], cwd=ROOT
        )

    def summary(self) -> Summary:
        return self.bus.ask(SUMMARY, None, Summary)

    def boxes(self) -> BoxCounts:
        found = self.summary().boxes
        assert found is not None
        return found

    def services(self) -> dict[str, int]:
        """Process ids by service."""
        marker = f"XDG_RUNTIME_DIR={self.folder}".encode()
        found = {}
        for entry in Path("/proc").iterdir():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0") if entry.name.isdigit() else []
                if (
                    len(words) > 2
                    and words[2].startswith(b"services.")
                    and marker in (entry / "environ").read_bytes()
                ):
                    found[words[2].decode().removeprefix("services.")] = int(entry.name)
            except OSError:
                continue
        return found


def chaos(folder: Path) -> int:
    """Kills, freezes, cuts and restarts one thing after the other."""
    cell = Cell(folder)
    before = set(cell.services())
    troubles: list[tuple[str, Callable[[], None]]] = []
    for name in ("controller", "bridge", "emulator", "recorder"):
        troubles.append((f"kill {name}", lambda name=name: os.kill(cell.services()[name], signal.SIGKILL)))
        troubles.append((f"freeze {name} for 2 s", lambda name=name: freeze(cell.services()[name])))
    troubles.append(("cut the bridge's network for 5 s", lambda: cut(cell.proxy)))
    troubles.append(("restart the router", lambda: restart(cell)))
    results = [disturb(cell, name, trouble) for name, trouble in troubles]
    parts = [len(read_log(part)) for part in (folder / "run.parquet.parts").glob("*.parquet")]
    kept = set(cell.services()) == before
    subprocess.run([sys.executable, "-m", "dtwin", "down"], cwd=ROOT, check=True)
    cell.bus.close()
    cell.router.terminate()
    cell.router.wait()
    left = cell.services()
    rows = len(read_log(folder / "run.parquet"))
    print(json.dumps({"troubles": results, "parts_readable": len(parts), "rows": rows, "left": left}, indent=1))
    return 0 if all(r["recovered"] and r["count_kept"] for r in results) and kept and not left else 1


def disturb(cell: Cell, name: str, trouble: Callable[[], None]) -> dict[str, Any]:
    """One trouble: whether the arm was made safe, and how long until it worked as before."""
    wait(lambda: calm(cell), 30)
    boxes, events = cell.boxes(), len(cell.events)
    began = time.monotonic()
    trouble()
    recovered = wait(lambda: calm(cell) and time.monotonic() - began > 1.0, 60)
    seconds = time.monotonic() - began
    time.sleep(2)
    after = cell.boxes()
    kinds = [event.kind for event in cell.events[events:]]
    known = after.picked - after.delivered - after.misplaced
    kept = after.arrived >= boxes.arrived and after.delivered >= boxes.delivered and known in (0, 1)
    result = {
        "trouble": name,
        "safe": not {"safe", "resumed"}.isdisjoint(kinds),
        "recovered": recovered,
        "seconds": round(seconds, 1),
        "count_kept": kept,
        "misplaced": after.misplaced - boxes.misplaced,
    }
    print(json.dumps(result), file=sys.stderr)
    return result


def calm(cell: Cell) -> bool:
    """Whether every service is well and ticks pass in real time."""
    try:
        first = cell.summary()
        time.sleep(0.5)
        second = cell.summary()
    except Exception:
        return False
    well = all(service.state == "running" for service in second.services.values())
    return well and second.ticks >= first.ticks and second.services["emulator"].rate_hz > 90


def freeze(pid: int) -> None:
    os.kill(pid, signal.SIGSTOP)
    time.sleep(2)
    os.kill(pid, signal.SIGCONT)


def cut(proxy: Proxy) -> None:
    proxy.cut.set()
    time.sleep(5)
    proxy.cut.clear()


def restart(cell: Cell) -> None:
    cell.router.kill()
    cell.router.wait()
    time.sleep(1)
    cell.start_router()


def wait(condition: Callable[[], bool], timeout: float) -> bool:
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.1)
    return False


if __name__ == "__main__":
    sys.exit(main())

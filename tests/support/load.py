"""Measures how much of a core each service of a cell in real time takes."""

import statistics
import sys
import time
from pathlib import Path

from dtwin.services import runfile
from tests.support.desk import new_desk

SETTLING = 30.0
"""Time in which services load what they need and the monitor gets to know the arm, s; it does not count."""
WINDOW = 10.0
"""s"""
NANOSECOND = 1e-9
"""s"""


def main() -> int:
    """Measures for the time that is given, two minutes otherwise; the words after it are options of `dtwin up`."""
    words, seconds = sys.argv[1:], 120.0
    if words[:1] == ["--seconds"]:
        seconds, words = float(words[1]), words[2:]
    with new_desk() as desk:
        desk.detach("--monitoring", *words)
        time.sleep(SETTLING)
        pids = _services(runfile.require("cell").pid)
        windows = [_shares(pids) for _ in range(max(round(seconds / WINDOW), 1))]
        desk.run("down")
    for name in sorted(pids):
        shares = sorted(100.0 * window[name] for window in windows)
        print(f"{name}: {statistics.median(shares):.1f} % of a core, {shares[0]:.1f} to {shares[-1]:.1f} in a window")
    return 0


def _services(supervisor: int) -> dict[str, int]:
    """The processes that a supervisor has started, by the names of their modules."""
    children = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    words = {pid: Path(f"/proc/{pid}/cmdline").read_text().split("\0") for pid in map(int, children)}
    return {line[line.index("-m") + 1].rpartition(".")[2]: pid for pid, line in words.items()}


def _shares(pids: dict[str, int]) -> dict[str, float]:
    """The share of a core that each process takes in a window."""
    before, began = {name: _used(pid) for name, pid in pids.items()}, time.monotonic()
    time.sleep(WINDOW)
    return {name: (_used(pid) - before[name]) / (time.monotonic() - began) for name, pid in pids.items()}


def _used(pid: int) -> float:
    """Time that all threads of a process have worked, s, to the nanosecond, which proc(5) tells of each alone."""
    threads = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return NANOSECOND * sum(int(thread.read_text().split()[0]) for thread in threads)


if __name__ == "__main__":
    sys.exit(main())

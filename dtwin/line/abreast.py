"""Stations of a line that work at the same time, on several cores of this process.

Stations know nothing of one another within a cycle, so that it makes no difference to their results who works when.
What takes long in a station is machine code, during which other threads run.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

from dtwin.line.station import Report, Station


class Abreast:
    """Lets stations work for some ticks, a share of them in each of several threads.

    Args:
        stations: the stations by their names.
        threads: number of threads, this one among them; at least 1.
    """

    def __init__(self, stations: Mapping[str, Station], threads: int) -> None:
        names = list(stations)
        self._order = names
        mine, *theirs = ([(name, stations[name]) for name in names[k::threads]] for k in range(threads))
        self._mine, self._theirs = mine, [share for share in theirs if share]
        self._pool = ThreadPoolExecutor(threads - 1, "stations") if self._theirs else None

    def step(self, ticks: int) -> dict[str, Report]:
        """The reports of all stations after some ticks, in their order.

        Raises:
            DtwinError: an arm or its blocks have failed; all other threads are done by then.
        """
        if self._pool is None:
            return _work(self._mine, ticks)
        others = [self._pool.submit(_work, share, ticks) for share in self._theirs]
        try:
            reports = _work(self._mine, ticks)
        finally:
            for other in others:
                other.exception()
        for other in others:
            reports |= other.result()
        return {name: reports[name] for name in self._order}


def _work(share: list[tuple[str, Station]], ticks: int) -> dict[str, Report]:
    return {name: station.advance(ticks) for name, station in share}

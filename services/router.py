"""A Zenoh router, for cells on several machines where no zenohd is installed."""

from __future__ import annotations

import logging
import signal
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.bus.opening import open_configured
from dtwin.parameters import ROOT
from dtwin.services.service import Link, hurry, main, watch_lifeline

log = logging.getLogger(__name__)

NAME: Final = "router"


@dataclass(frozen=True, kw_only=True)
class Options(Link):
    """Route between the machines of a cell, after the file router.json5 of a folder."""

    zenoh: Path | None = ROOT / "config" / "routed"

    def run(self) -> int:
        watch_lifeline()
        if self.urgent:
            hurry()
        session = open_configured(self.zenoh or ROOT / "config" / "routed", NAME)
        stop = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stop.set())
        log.info("routing")
        while not stop.wait(1.0):
            pass
        session.close()
        return 0


if __name__ == "__main__":
    sys.exit(main(NAME, Options))

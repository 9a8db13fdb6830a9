"""`dtwin bench upload`."""

from __future__ import annotations

import getpass
import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import msgspec

from dtwin.bus.messages import ROLL_BACK, SUMMARY, UPLOAD, Summary
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import RollBackRequest, Upload, UploadRequest
from dtwin.commands.frame import at_least
from dtwin.services.runfile import join
from dtwin.terminal import print_json

_WHY = "dtwin bench upload"
_CHANGE = 1.001
"""factor on a setting: the setting is another one, the controller hardly"""
_PAUSE = 0.1
"""s between two uploads"""
_SETTLE = 1.2
"""s after which the emulator has told its late ticks"""


@dataclass(frozen=True, kw_only=True)
class BenchUpload:
    """Time uploads to a running cell from request to acknowledgement; each is taken back at once.

    Gains and the arm model take turns, each slightly changed and with all checks. The cell must have been started
    with `dtwin up --simulation`. One JSON object is printed.
    """

    rounds: int = 40
    """Number of uploads."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""

    def execute(self) -> int:
        at_least("--rounds", self.rounds, 2)
        with join(self.cell, self.zenoh) as bus:
            before = _late(bus)
            spent = [1e3 * _upload(bus, "model" if number % 2 else "gains") for number in range(self.rounds)]
            late = _late(bus) - before
        result = {"uploads": self.rounds, "median_ms": median(spent), "worst_ms": max(spent), "late_ticks": late}
        print_json(result)
        return 0


def _upload(bus: Bus, what: str) -> float:
    """One upload, taken back; s to its acknowledgement."""
    now = bus.ask(UPLOAD, None, Upload)
    request = UploadRequest(getpass.getuser(), _WHY, now.version)
    if what == "gains":
        kp_1, kp_2, kp_3 = (_CHANGE * value for value in now.gains.kp)
        request = msgspec.structs.replace(request, gains=replace(now.gains, kp=(kp_1, kp_2, kp_3)))
    else:
        request = msgspec.structs.replace(request, model=now.model.with_values({"D1": _CHANGE * now.model.get("D1")}))
    began = time.perf_counter()
    bus.ask(UPLOAD, request, Upload)
    spent = time.perf_counter() - began
    time.sleep(_PAUSE)
    if bus.ask(UPLOAD, None, Upload).on_trial:
        bus.ask(ROLL_BACK, RollBackRequest(getpass.getuser(), _WHY), Upload)
    return spent


def _late(bus: Bus) -> int:
    time.sleep(_SETTLE)
    return bus.ask(SUMMARY, None, Summary).late_ticks

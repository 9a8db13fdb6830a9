"""What must outlast the death of any process: a stop, and the settings in force."""

from __future__ import annotations

import os
import signal
from typing import Final

from dtwin.bus.messages import (
    RELEASE,
    SETTINGS,
    STOP,
    UPLOAD,
    ReleaseRequest,
    SettingsInForce,
    StopRequest,
    StopState,
)
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.errors import CommunicationError
from evidence.soak.cell import TroubledCell, wait

_BACK: Final = 30.0
"""s that killed services have to answer again"""
_TRIAL: Final = 70.0
"""s that settings have to be confirmed; a trial takes at most 60 s of plant time"""
_WHO: Final = "soak"


def stopped(services: tuple[str, ...], cell: TroubledCell) -> str:
    """Stops the arm and kills services: the stop must be there when they are back, until it is released."""
    cell.bus.ask(STOP, StopRequest(_WHO, "it must outlast the services"), StopState)
    if not wait(lambda: _stop(cell) in ("standstill", "torque off"), _BACK):
        return "does not stop"
    _kill(services, cell)
    if not wait(lambda: _stop(cell) != "", _BACK):
        return "does not come back"
    after = _stop(cell)
    released = wait(lambda: _release(cell) == "none", _BACK)
    if after not in ("standstill", "torque off"):
        return f"stop reads {after}"
    return "" if released else "cannot be released"


def settled(services: tuple[str, ...], cell: TroubledCell) -> str:
    """Uploads a target time, waits until it is confirmed, and kills services: it must be in force afterwards."""
    now = cell.bus.ask(UPLOAD, None, Upload)
    wanted = 2.5 if now.target_time < 2.4 else 2.0
    request = UploadRequest(_WHO, "it must outlast the services", now.version, target_time=wanted)
    cell.bus.ask(UPLOAD, request, Upload)
    if not wait(lambda: not cell.bus.ask(UPLOAD, None, Upload).on_trial, _TRIAL):
        return "stays on trial"
    outcome = cell.bus.ask(UPLOAD, None, Upload)
    if outcome.action != "confirm":
        return f"is not confirmed: {outcome.text}"
    _kill(services, cell)
    if not wait(lambda: _target_time(cell) > 0, _BACK):
        return "does not come back"
    found = _target_time(cell)
    return "" if found == wanted else f"target time {found:g} s for {wanted:g} s"


def _kill(services: tuple[str, ...], cell: TroubledCell) -> None:
    pids = cell.services()
    for service in services:
        os.kill(pids[service], signal.SIGKILL)
    wait(lambda: all(cell.services().get(service) not in (None, pids[service]) for service in services), _BACK)


def _stop(cell: TroubledCell) -> str:
    """The stop in force, "" while nobody answers."""
    try:
        return cell.bus.ask(STOP, None, StopState).stop
    except CommunicationError:
        return ""


def _release(cell: TroubledCell) -> str:
    try:
        return cell.bus.ask(RELEASE, ReleaseRequest(_WHO, "it has been seen"), StopState).stop
    except CommunicationError:
        return ""


def _target_time(cell: TroubledCell) -> float:
    """The target time in force, s; 0 while nobody answers."""
    try:
        return cell.bus.ask(SETTINGS, None, SettingsInForce).target_time
    except CommunicationError:
        return 0.0

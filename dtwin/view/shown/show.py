"""A recording opened in a viewer at the moment that is worth a look.

Rerun keeps no place of the cursor in a recording's layout, so that the viewer is told once it has the recording.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import pyarrow as pa
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from dtwin.errors import CommunicationError, RecordingError
from dtwin.files import PICTURE, ensure_writable, reason_of, replacing
from dtwin.view.series import TIMELINE
from dtwin.view.story import MARKS
from dtwin.view.viewer import LOOPBACK, Ports, free_ports, listens

_SETTLES: Final = 3.0
"""Time in which a viewer without a window fetches and draws what it is to show, s."""
_STARTS: Final = 60.0
"""Longest wait for a viewer to listen, s: it loads its graphics driver first."""
_LOOK: Final = 0.05
"""Time between two looks whether it does, s."""
_ENDS: Final = 2.0
"""Time in which a viewer that cannot open its window ends, s."""
_ENDED: Final = (
    "the viewer ended at once: it needs a display, or --picture without one, and a Vulkan driver:"
    " where there is no GPU, the package mesa-vulkan-drivers"
)
_KINDS: Final = ("finding", "fault", "stop")
"""What a recording opens on, the first of these that it has."""


def opening(recording: Path) -> float | None:
    """Plant time of the first finding in a recording, or else of its first fault or stop, s; None for none of them.

    Raises:
        RecordingError: the file is missing or no recording of a run.
    """
    try:
        with recording.open("rb"):
            pass
        chunks = RrdReader(recording).stream().to_chunks()
    except OSError as error:
        raise RecordingError(f"{recording}: cannot be read: {reason_of(error)}") from None
    except (RuntimeError, ValueError) as error:
        raise RecordingError(f"{recording}: expected a recording of Rerun (*.rrd): {_line(error)}") from None
    kinds: dict[str, str] = {}
    times: dict[str, float] = {}
    for chunk in chunks:
        if not chunk.entity_path.startswith(f"/{MARKS}/"):
            continue
        batch = chunk.to_record_batch()
        if "SeriesLines:names" in batch.schema.names:
            [[name]] = batch["SeriesLines:names"].to_pylist()
            kinds[chunk.entity_path] = name.partition(" ")[0]
        if TIMELINE in batch.schema.names:
            times[chunk.entity_path] = batch[TIMELINE].cast(pa.int64())[0].as_py() / 1e9
    for kind in _KINDS:
        if found := [moment for entity, moment in times.items() if kinds.get(entity) == kind]:
            return min(found)
    return None


def show(recording: Path, at: float | None = None, picture: Path | None = None) -> float | None:
    """Opens a recording in a viewer of its own on the loopback interface, paused at a moment.

    Args:
        recording: .rrd file.
        at: plant time, s; None for that of `opening`.
        picture: PNG file to draw instead of opening a window; None for a window, which stays open.

    Returns:
        The plant time at which the recording is shown, s; None for its start.

    Raises:
        RecordingError: the recording cannot be read, or the picture cannot be written.
        CommunicationError: the viewer does not start, as without a display, or does not answer.
    """
    first = opening(recording)
    moment = first if at is None else at
    if picture is not None:
        ensure_writable(picture, PICTURE)
    ports = Ports(data=free_ports().data)
    command = [sys.executable, "-m", "rerun_cli", "--bind", LOOPBACK, "--port", str(ports.data)]
    viewer = subprocess.Popen(
        [*command, "--headless"] if picture is not None else command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    shown = False
    try:
        _wait(ports, viewer)
        _open(ports, recording, moment, picture)
        shown = True
    except (RuntimeError, ConnectionError, ValueError) as error:
        with contextlib.suppress(subprocess.TimeoutExpired):
            viewer.wait(_ENDS)
            raise CommunicationError(_ENDED) from None
        raise CommunicationError(f"{recording}: the viewer does not show it: {_line(error)}") from None
    finally:
        if picture is not None or not shown:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(viewer.pid, signal.SIGKILL)
            viewer.wait()
    return moment


def _wait(ports: Ports, viewer: subprocess.Popen[bytes]) -> None:
    """Waits until a viewer listens for data."""
    deadline = time.monotonic() + _STARTS
    while not listens(ports.data):
        if viewer.poll() is not None:
            raise CommunicationError(_ENDED)
        if time.monotonic() > deadline:
            raise CommunicationError(f"the viewer does not listen at {LOOPBACK}:{ports.data} after {_STARTS:g} s")
        time.sleep(_LOOK)


def _open(ports: Ports, recording: Path, moment: float | None, picture: Path | None) -> None:
    client = ViewerClient.connect(ports.data_url)
    client.open(str(recording.resolve()))
    if moment is not None:
        client.set_time(TIMELINE, duration=moment, play_state="paused")
    if picture is not None:
        time.sleep(_SETTLES)
        with replacing(picture) as temporary:
            temporary.write_bytes(client.take_screenshot())


def _line(error: Exception) -> str:
    return " ".join(str(error).split())

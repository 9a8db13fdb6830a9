"""A log of any arm as a film: its own shapes at the logged positions, seen so that all that it does fits in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.picture import VIEWS, ChainStudio
from dtwin.equations.kinematics import tool_of
from dtwin.errors import ParameterError, choices
from dtwin.measurements.measurement import Measurement
from dtwin.view.shown.film import DARK, check_kind, encode, write_lines
from dtwin.view.shown.film_settings import FilmSettings


def write_chain_film(
    measurement: Measurement,
    arm: Arm,
    path: Path,
    settings: FilmSettings,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> int:
    """Renders a log of an arm to a film; the file appears complete or not at all. Equal logs give equal pictures.

    Args:
        measurement: the log. Episodes follow each other without a gap.
        arm: the arm with the file of its shapes.
        path: file to write, *.mp4 or *.gif.
        settings: how the film is made.
        progress: told the pictures done and their number.

    Returns:
        The number of pictures.

    Raises:
        ParameterError: a setting does not fit the log, or the name of the file says no kind of film.
        RecordingError: the path cannot be written.
        DtwinError: there is no OpenGL here, or no encoder.
    """
    check_kind(path, settings)
    if settings.camera not in VIEWS:
        raise ParameterError(f"camera {settings.camera!r}: expected {choices(VIEWS)}")
    t = _running(measurement)
    ticks = settings.ticks(t)
    encode(path, _pictures(t, measurement.q, arm, settings, ticks, progress), settings, len(ticks))
    return len(ticks)


def _running(measurement: Measurement) -> Array:
    """Time in which every stretch begins a usual step after the one before, (N,), s."""
    steps = np.diff(measurement.t)
    steps[np.asarray(measurement.starts[1:], dtype=np.int64) - 1] = np.median(steps)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _pictures(
    t: Array,
    q: Array,
    arm: Arm,
    settings: FilmSettings,
    ticks: NDArray[np.int64],
    progress: Callable[[int, int], None],
) -> Iterator[Image.Image]:
    with ChainStudio(arm, q, tool_of(arm, q)[0], settings.width, settings.height, settings.camera) as studio:
        for done, tick in enumerate(ticks.tolist()):
            picture = Image.fromarray(studio.picture(q[tick]))
            if settings.caption:
                write_lines(picture, [(f"{t[tick]:.2f} s", DARK)])
            yield picture
            progress(done + 1, len(ticks))

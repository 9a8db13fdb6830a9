"""A run of the cell as a value: columns, events, score, picture, recording, log file."""

from __future__ import annotations

import importlib
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from dtwin.api.arguments import AnyPath, checked
from dtwin.emulation import MODEL_FILE
from dtwin.errors import DtwinError, ParameterError, RecordingError, choices
from dtwin.logs.log import Log
from dtwin.logs.reading import completed, read_log
from dtwin.measurements.arrays import Numbers
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.cell import RunSummary
from dtwin.run.hidden import HiddenLog
from dtwin.run.settings import arm_of
from dtwin.signals import Event

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FrameLibrary = Literal["pandas", "polars"]
_LIBRARIES: Final[tuple[FrameLibrary, ...]] = ("pandas", "polars")


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A run of the cell, made by `Cell.run` or `Run.from_arrays`, or read by `load`.

    Attributes:
        log: the run in columns, one row per 10 ms tick, with its events and what it was made with; read-only.
        model_file: MJCF file that the arm is drawn from.
        summary: what came of the run; None where it was loaded, as a log does not hold it.
        hidden: what acted in the drives and touched, where that was collected.
        source: where it comes from, in words: the file that it was loaded from.
    """

    log: Log
    model_file: Path = MODEL_FILE
    summary: RunSummary | None = None
    hidden: HiddenLog | None = None
    source: str = "a run"

    @property
    def arm(self) -> ArmParameters:
        """The parameters that the arm was made to, SI units; the data sheet's where the log says nothing of it.

        Raises:
            DtwinError: what the log says of its arm cannot be used.
        """
        return arm_of(self.log.metadata)

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened, in order of time: plant time (s), kind and text of every event."""
        return self.log.events

    @property
    def score(self) -> RunSummary:
        """The summary of the run: boxes, placement error (mm), tracking error (rad), saturated ticks, events by kind.

        Raises:
            RecordingError: the run was loaded, and a log does not hold where its boxes came to lie.
        """
        if self.summary is None:
            raise RecordingError("score: expected a run of Cell.run; a log does not hold where boxes came to lie")
        return self.summary

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """The columns by name, each of shape (ticks,) and read-only.

        They are `t` (s), `theta_1` to `theta_3` (rad) and `omega_1` to `omega_3` (rad/s) as they truly were,
        `measured_1` to `measured_3` and `target_1` to `target_3` (rad), `volts_1` to `volts_4` (V), `gripper` (rad),
        `payload_mass` (kg), `box_present`, `box_colour` and `box_gripped`.
        """
        return self.log.columns

    @checked
    def frame(self, library: FrameLibrary | None = None) -> Any:
        """The columns as a data frame.

        Args:
            library: pandas or polars; None for the one that is installed, pandas first.

        Returns:
            A `pandas.DataFrame` or a `polars.DataFrame`.

        Raises:
            DtwinError: the library is not installed.
        """
        for name in _LIBRARIES if library is None else (library,):
            try:
                module = importlib.import_module(name)
            except ImportError:
                continue
            table = self.log.table()
            return table.to_pandas() if name == "pandas" else module.from_arrow(table)
        wanted = library or "pandas or polars"
        advice = "pip install 'dtwin[frames]', or take arrays()"
        raise DtwinError(f"frame: expected {wanted} to be installed: {advice}")

    def plot(self) -> Figure:
        """A picture of the run: measured angles on their paths (rad), voltages (V), events marked.

        Returns:
            A figure of Matplotlib, for notebooks and `savefig`.
        """
        from dtwin.api.plots import draw_run  # Matplotlib takes half a second to load.

        return draw_run(self.log)

    @checked
    def record(self, path: AnyPath) -> None:
        """Writes a recording for the Rerun viewer.

        Args:
            path: file to write, *.rrd; it appears complete or not at all.

        Raises:
            RecordingError: the run has no tick, or the path cannot be written.
        """
        from dtwin.view.write import write_recording  # Rerun takes half a second to import.

        write_recording(self.log, self.model_file, Path(path), self.arm, self.hidden)

    @checked
    def save(self, path: AnyPath) -> None:
        """Writes the log as a Parquet file, byte by byte that of `dtwin run --log` with the same settings.

        Args:
            path: file to write, *.parquet; it appears complete or not at all.

        Raises:
            RecordingError: the path cannot be written.
        """
        self.log.write_parquet(Path(path))

    @classmethod
    @checked
    def from_arrays(
        cls,
        measured: Numbers,
        volts: Numbers,
        *,
        t: Numbers | None = None,
        box_gripped: Numbers | None = None,
        target: Numbers | None = None,
        gripper: Numbers | None = None,
        box_colour: Numbers | None = None,
    ) -> Run:
        """Makes a run of what was measured of an arm, to identify it, to monitor it or to save it as a log.

        Row k holds a sample and the voltages that acted from then on until the next one, 10 ms later.

        Args:
            measured: (N, 3), joint angles as the encoders read them, rad, without jumps by a turn.
            volts: (N, 3) or, with that of the gripper, (N, 4), voltages of the motors, V.
            t: (N,), time, s; None for one row a tick from 0 on. Ticks may be missing.
            box_gripped: (N,), whether a box is held; None for never.
            target: (N, 3), desired angles, rad; None where nobody knows them.
            gripper: (N,), readings of the gripper's encoder, rad; None where there is none.
            box_colour: (N,), colour of the box that waits, "" for none; None where nobody looks.

        Raises:
            ParameterError: the shapes do not agree.
            RecordingError: a number is not finite or out of range, or the rows are no ticks; the message names
                column and row.
        """
        rows = len(measured)
        given: dict[str, NDArray[Any]] = {
            **_columns("measured", measured, rows, (3,)),
            **_columns("volts", volts, rows, (3, 4)),
            **({} if target is None else _columns("target", target, rows, (3,))),
            "t": PERIOD * np.arange(rows) if t is None else _column("t", t, rows),
            "box_gripped": np.zeros(rows, bool)
            if box_gripped is None
            else _column("box_gripped", box_gripped, rows) != 0,
        }
        if gripper is not None:
            given["gripper"] = _column("gripper", gripper, rows)
        if box_colour is not None:
            given["box_colour"] = _column("box_colour", box_colour, rows, np.str_)
        return cls(Log(completed("arrays", given, rows)), source="arrays")


class RunError(DtwinError):
    """A run failed on its way.

    Attributes:
        run: the run until then.
    """

    def __init__(self, message: str, run: Run) -> None:
        super().__init__(message)
        self.run = run


@checked
def load(path: AnyPath) -> Run:
    """Reads a run from the log that `Run.save`, `dtwin run --log` or `dtwin up --log` wrote.

    Args:
        path: Parquet file.

    Raises:
        RecordingError: the file is missing or no log.
    """
    return Run(read_log(Path(path)), source=str(path))


def _columns(name: str, values: Numbers, rows: int, widths: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """The columns NAME_1, NAME_2 and so on."""
    array = _array(name, values)
    if array.ndim != 2 or len(array) != rows or array.shape[1] not in widths:
        expected = choices(f"({rows}, {width})" for width in widths)
        raise ParameterError(f"{name}: expected shape {expected}, got {array.shape}")
    return {f"{name}_{number}": column.copy() for number, column in enumerate(array.T, 1)}


def _column(name: str, values: Numbers, rows: int, kind: type[np.generic] = np.float64) -> NDArray[Any]:
    array = _array(name, values, kind)
    if array.shape != (rows,):
        raise ParameterError(f"{name}: expected shape ({rows},), got {array.shape}")
    return array


def _array(name: str, values: Numbers, kind: type[np.generic] = np.float64) -> NDArray[Any]:
    try:
        return np.array(values, dtype=kind)
    except (TypeError, ValueError):
        raise ParameterError(f"{name}: expected numbers, got {reprlib.repr(values)}") from None


def log_of(data: Run | AnyPath) -> Log:
    """The log of a run or of a Parquet file.

    Raises:
        RecordingError: the file is missing or no log.
    """
    return data.log if isinstance(data, Run) else read_log(Path(data))

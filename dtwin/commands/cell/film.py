"""`dtwin film`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from dtwin.emulation import MODEL_FILE
from dtwin.errors import ParameterError, RecordingError
from dtwin.files import ensure_writable
from dtwin.terminal import printable
from dtwin.view.shown.film_settings import FilmSettings

Progressed = Callable[[int, int], None]
"""Told the pictures done and their number."""


@dataclass(frozen=True, kw_only=True)
class FilmCommand(FilmSettings):
    """Render a log to a film with MuJoCo's own renderer: the cell with shadows, time, state and what happened.

    It needs OpenGL but no display and no GPU (`apt install libegl1 libgl1-mesa-dri`); without one a picture takes
    some tenths of a second. An MP4 needs `pip install 'dtwin[film]'`, a GIF nothing more.
    """

    log: tyro.conf.Positional[Path]
    """Parquet log of `dtwin run --log` or `dtwin up --log`."""
    file: tyro.conf.Positional[Path]
    """Film to write, *.mp4 or *.gif."""
    mjcf: Path = MODEL_FILE
    """MJCF file of the thesis's arm."""
    arm: str | None = None
    """Name of arms/, file of an arm (*.toml), or a model (*.urdf, *.xml) whose log this is, in any format that
    `dtwin log show` reads; cameras are overview, front, side and top then."""
    columns: Path | None = None
    """TOML file that says what the columns mean (--arm); guessed if not given."""

    def execute(self) -> int:
        if self.log.suffix == ".rrd":
            raise RecordingError(f"{self.log}: expected the log of `dtwin run --log`, not a recording")
        if self.columns is not None and self.arm is None:
            raise ParameterError("--columns belongs to --arm: give the arm whose log this is")
        film = self._film() if self.arm is None else self._chain_film(self.arm)
        ensure_writable(self.file)
        columns = (TextColumn("rendering"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        console = Console(file=sys.stderr)
        with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
            task = bar.add_task("", total=None)

            def progress(done: int, of: int) -> None:
                bar.update(task, completed=done, total=of)

            count = film(progress)
        print(printable(f"{self.file}: {count} pictures, {count / self.fps:.1f} s"))
        return 0

    def _film(self) -> Callable[[Progressed], int]:
        from dtwin.logs.reading import read_log
        from dtwin.run.settings import arm_of
        from dtwin.view.shown.film import write_film  # MuJoCo takes a while to load.

        log = read_log(self.log)
        return lambda progress: write_film(log, self.mjcf, self.file, arm_of(log.metadata), self, progress)

    def _chain_film(self, arm: str) -> Callable[[Progressed], int]:
        import dtwin.emulation.picture  # noqa: F401  says which OpenGL MuJoCo takes, before MuJoCo is loaded
        from dtwin.emulation.chain.arms import arm_of
        from dtwin.measurements.columns import read_map
        from dtwin.measurements.reading import read_measurement
        from dtwin.view.chain.film import write_chain_film

        chain = arm_of(arm)
        columns = None if self.columns is None else read_map(self.columns)
        measurement = read_measurement(self.log, columns, chain)
        return lambda progress: write_chain_film(measurement, chain, self.file, self, progress)

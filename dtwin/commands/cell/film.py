"""`dtwin film`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from dtwin.emulation import MODEL_FILE
from dtwin.errors import RecordingError
from dtwin.files import ensure_writable
from dtwin.terminal import printable
from dtwin.view.shown.film_settings import FilmSettings


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
    """MJCF file of the arm."""

    def execute(self) -> int:
        from dtwin.logs.reading import read_log
        from dtwin.run.settings import arm_of
        from dtwin.view.shown.film import write_film  # MuJoCo takes a while to load.

        if self.log.suffix == ".rrd":
            raise RecordingError(f"{self.log}: expected the log of `dtwin run --log`, not a recording")
        log = read_log(self.log)
        ensure_writable(self.file)
        columns = (TextColumn("rendering"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        console = Console(file=sys.stderr)
        with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
            task = bar.add_task("", total=None)

            def progress(done: int, of: int) -> None:
                bar.update(task, completed=done, total=of)

            count = write_film(log, self.mjcf, self.file, arm_of(log.metadata), self, progress)
        print(printable(f"{self.file}: {count} pictures, {count / self.fps:.1f} s"))
        return 0

"""Takes the pictures of docs/recordings.md and of the first page: recordings in the viewer, and a film of a log."""

import os
import subprocess
import sys
import tarfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import tyro
from PIL import Image

from dtwin.parameters import ROOT
from dtwin.run.recording import read_log
from dtwin.signals import EventKind

FAULT: Final = ("--fault", "K2*=0.1@45", "--duration", "60")
AT_WORK: Final = "16.6"
"""Plant time at which the arm carries the first box, s."""
FALLEN: Final = "48.1"
"""Plant time at which the arm has left its path, s."""
WIDTH: Final = 1400
COLOURS: Final = 256


@dataclass(frozen=True)
class Pictures:
    """Take the pictures of recordings."""

    folder: Path = ROOT / "docs"
    """Folder to write them to."""
    before: str | None = None
    """Commit of which a recording is shown as it opened then; no such picture without it."""

    def take(self) -> None:
        folder = self.folder.resolve()
        with TemporaryDirectory() as work:
            os.chdir(work)
            dtwin("run", *FAULT, "--record", "run.rrd", "--log", "run.parquet")
            dtwin("monitor", "run.parquet", "--record", "monitor.rrd", status=1)
            picture("run.rrd", AT_WORK, folder / "cell.png")
            picture("monitor.rrd", FALLEN, folder / "recording.png")
            services = ("--pace", "lockstep", "--monitoring", "--safe-stop")
            dtwin("up", *services, *FAULT, "--record", "stop.rrd", "--log", "stop.parquet")
            stop = max(event.time for event in read_log(Path("stop.parquet")).events if event.kind == EventKind.STOP)
            picture("stop.rrd", f"{stop + 0.5:g}", folder / "recording-stop.png")
            film = ("--start", "37", "--end", "49", "--speed", "2", "--fps", "8", "--width", "480", "--height", "270")
            dtwin("film", "run.parquet", str(folder / "film.gif"), *film)
            if self.before is not None:
                unpack(self.before, Path("before"))
                dtwin("monitor", "run.parquet", "--record", "before.rrd", status=1, root=Path("before").resolve())
                picture("before.rrd", "0.7", folder / "recording-before.png")


def dtwin(*arguments: str, status: int = 0, root: Path = ROOT) -> None:
    """Runs a command of the sources in a folder, which has to end with a status."""
    command = [sys.executable, "-m", "dtwin", *arguments]
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(root)}, check=False)
    if done.returncode != status:
        raise SystemExit(f"{' '.join(command)}: expected the exit status {status}, got {done.returncode}")


def picture(recording: str, at: str, file: Path) -> None:
    """Draws a recording at a plant time (s), small enough for a page."""
    dtwin("show", recording, "--at", at, "--picture", "shown.png")
    with Image.open("shown.png") as shown:
        size = (WIDTH, round(shown.height * WIDTH / shown.width))
        shown.convert("RGB").resize(size, Image.Resampling.LANCZOS).quantize(
            COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
        ).save(file, optimize=True)


def unpack(commit: str, folder: Path) -> None:
    """Unpacks the sources of a commit."""
    done = subprocess.run(["git", "-C", str(ROOT), "archive", commit], capture_output=True, check=True)
    with tarfile.open(fileobj=BytesIO(done.stdout)) as archive:
        archive.extractall(folder, filter="tar")


if __name__ == "__main__":
    tyro.cli(Pictures).take()

"""Takes the pictures of docs/recordings.md and of the first page: recordings in the viewer, and a film of a log.

With --distances it prints the table of that page instead: how far the ghost is from the arm.
"""

import os
import subprocess
import sys
import tarfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import tyro
from PIL import Image

from dtwin.identification.machine.record import read_record
from dtwin.logs.reading import read_log
from dtwin.monitoring.estimation.belief import believed_arm, commissioned
from dtwin.parameters import PERIOD, ROOT
from dtwin.run.prediction import TICKS, BelievedArm, OpenLoop, believed_by_controller
from dtwin.signals import EventKind

FAULT: Final = ("--fault", "K2*=0.1@45", "--duration", "60")
AT_WORK: Final = "16.6"
"""Plant time at which the arm carries the first box, s."""
FALLEN: Final = "48.1"
"""Plant time at which the arm has left its path, s."""
RUNS: Final = {
    "ideal arm": (),
    "`--noise 0.003`": ("--noise", "0.003"),
    "`--fault 'K2*=0.5@60'`": ("--fault", "K2*=0.5@60"),
    "`--fault freeze2@60`": ("--fault", "freeze2@60"),
    "`--fault mu2=0.05@60`": ("--fault", "mu2=0.05@60"),
    "`--machine servo`, as the data sheet has it": ("--machine", "servo"),
}
"""Runs whose ghosts are compared with their arms."""
LONGER: Final = (50, 200)
"""Ticks of rollouts that are longer than that of a ghost."""
WIDTH: Final = 1400
COLOURS: Final = 256


@dataclass(frozen=True)
class Pictures:
    """Take the pictures of recordings."""

    folder: Path = ROOT / "docs"
    """Folder to write them to."""
    before: str | None = None
    """Commit of which a recording is shown as it opened then; no such picture without it."""

    distances: bool = False
    """Print how far the ghosts of some runs are from their arms, and take no pictures."""

    def run(self) -> None:
        if self.distances:
            measure()
        else:
            self.take()

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


def measure() -> None:
    """Prints the table of distances."""
    with TemporaryDirectory() as work:
        os.chdir(work)
        for name, options in RUNS.items():
            dtwin("run", "--duration", "120", *options, "--log", "run.parquet", "--json")
            tell(name)
            if not options:
                for ticks in LONGER:
                    tell(f"the same over {ticks * PERIOD:g} s", ticks=ticks)
        dtwin("run", "--duration", "240", "--machine", "servo", "--log", "work.parquet", "--json")
        dtwin("commission", "work.parquet", "--out", "arm.json")
        tuned = ("--machine", "servo", "--tuned", "arm.json")
        dtwin("run", "--duration", "120", *tuned, "--log", "run.parquet", "--json")
        tell("the same with `--tuned`")
        record = believed_arm(commissioned(read_record(Path("arm.json"))))
        tell("the same with its record, `--commissioned`", record)


def tell(name: str, believed: BelievedArm | None = None, ticks: int = TICKS) -> None:
    """Prints the row of the last run, from its fault on if it has one."""
    log = read_log(Path("run.parquet"))
    _, angles = OpenLoop(believed or believed_by_controller(log.metadata), ticks=ticks).add(log)
    since = min((event.time for event in log.events if event.kind == EventKind.FAULT), default=0.0)
    away = 1e3 * np.abs(angles - log.angles())[log.columns["t"] >= since]
    figures = np.median(away, axis=0), np.percentile(away, 99, axis=0), away.max(axis=0)
    cells = (", ".join(f"{value:.{1 if value < 9.95 else 0}f}" for value in joints) for joints in figures)
    print(f"| {name} | {' | '.join(cells)} |", flush=True)


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
    tyro.cli(Pictures).run()

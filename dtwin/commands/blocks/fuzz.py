"""`dtwin fb fuzz`: a device of its own under mutated requests and datagrams."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.progress import Progress

from dtwin.errors import ParameterError
from dtwin.experiments.hostile.trial import fuzz


@dataclass(frozen=True)
class FbFuzz:
    """Send a device of its own mutated management requests and datagrams, and measure what they do to it.

    The device must answer every request and stay alive. The exit status is 1 if a tick of another resource
    came more than 50 ms later than those of a device that nobody troubles, memory grew by more than 20 MB or the log
    has more than 100 lines.
    """

    requests: int = 200_000
    """Number of management requests."""
    datagrams: int = 100_000
    """Number of datagrams."""
    seed: int = 1
    """Number of the random generator of the inputs."""
    log: Path | None = None
    """File for the log of the device; without it the log is counted and forgotten."""

    def execute(self) -> int:
        if self.requests < 1 or self.datagrams < 0:
            raise ParameterError("--requests and --datagrams: expected at least 1 and 0")
        total = self.requests + self.datagrams
        with TemporaryDirectory() as folder, Progress() as bar:
            task = bar.add_task("inputs", total=total)
            log = self.log or Path(folder) / "device.log"
            outcome = fuzz(self.requests, self.datagrams, self.seed, log, lambda n: bar.update(task, completed=n))
            bar.update(task, completed=total)
        print(f"requests          {outcome.requests}, {outcome.answered} answered")
        print(f"datagrams         {outcome.datagrams}")
        print(f"latest tick       {outcome.latest * 1000:.1f} ms late, of {outcome.ticks} ticks")
        print(
            f"undisturbed       {outcome.undisturbed * 1000:.1f} ms late, the ticks of a device that nobody troubles"
        )
        print(f"memory            {outcome.growth / 1e6:+.1f} MB")
        print(f"log               {outcome.lines} lines")
        print(f"time              {outcome.duration:.0f} s")
        return int(outcome.latest - outcome.undisturbed > 0.05 or outcome.growth > 20e6 or outcome.lines > 100)

"""`dtwin history`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dtwin.errors import RecordingError
from dtwin.services.runfile import kept
from dtwin.simulation.history import HISTORY, Entry, History
from dtwin.terminal import print_json, printable


@dataclass(frozen=True)
class ShowHistory:
    """Show every change of the controller's settings: when, who, why, what, and what came of it."""

    file: Path | None = None
    """File of the history; that of the cell if it is up on this machine, else uploads.jsonl, if not given."""
    cell: str = "cell"
    """Name of the cell."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        file = self.file or kept(self.cell, "history", HISTORY)
        if not file.exists():
            raise RecordingError(f"{file}: there is no history yet; the simulation service keeps it")
        entries = History(file).entries()
        if self.json:
            print_json({"entries": entries})
            return 0
        for entry in entries:
            what = f"{entry.action} {entry.kind}".strip()
            reason = f": {entry.why}" if entry.why else ""
            print(printable(f"{entry.time:10.2f} s  version {entry.version}  {what} by {entry.who}{reason}"))
            if entry.text:
                print(printable(f"{'':14}{entry.text}"))
            if entry.action in ("start", "upload", "roll back"):
                print(f"{'':14}{_settings(entry)}")
        return 0


def _settings(entry: Entry) -> str:
    settings = entry.settings
    if entry.kind == "model":
        model = settings.model
        return f"K {_list(model.voltage_constant)}, m {_list(model.mass)}, D {_list(model.damping)}"
    gains = settings.gains
    return f"kp {_list(gains.kp)}, ki {_list(gains.ki)}, kd {_list(gains.kd)}, T {settings.target_time:g} s"


def _list(values: tuple[float, ...]) -> str:
    return "/".join(f"{value:.4g}" for value in values)

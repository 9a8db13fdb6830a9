"""`dtwin history`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dtwin.api.kept.history import history
from dtwin.arm.model import ArmModel, ArmTuning
from dtwin.simulation.history import Entry
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
        entries = history(file=self.file, cell=self.cell)
        if self.json:
            print_json({"entries": entries})
            return 0
        for entry in entries:
            kind = entry.kind if isinstance(entry, Entry) else "settings"
            what = f"{entry.action} {kind}".strip()
            reason = f": {entry.why}" if entry.why else ""
            print(printable(f"{entry.time:10.2f} s  version {entry.version}  {what} by {entry.who}{reason}"))
            if entry.text:
                print(printable(f"{'':14}{entry.text}"))
            if entry.action in ("start", "upload", "roll back"):
                print(
                    f"{'':14}{_settings(entry) if isinstance(entry, Entry) else _of_arm(entry.model, entry.tuning)}"
                )
        return 0


def _of_arm(model: ArmModel, tuning: ArmTuning) -> str:
    mass = sum(body[0] for body in model.bodies)
    lost = f"viscous {_list(model.viscous)}, coulomb {_list(model.coulomb)}"
    how = f"pole {tuning.pole:g} rad/s, observer {tuning.observer:g} rad/s, speed {tuning.speed:g}"
    return f"{how}, {mass:.4g} kg, constants {_list(model.constant)}, {lost}"


def _settings(entry: Entry) -> str:
    settings = entry.settings
    if entry.kind == "model":
        model = settings.model
        return f"K {_list(model.voltage_constant)}, m {_list(model.mass)}, D {_list(model.damping)}"
    gains = settings.gains
    return f"kp {_list(gains.kp)}, ki {_list(gains.ki)}, kd {_list(gains.kd)}, T {settings.target_time:g} s"


def _list(values: tuple[float, ...]) -> str:
    return "/".join(f"{value:.4g}" for value in values)

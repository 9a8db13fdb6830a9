"""A run of the whole cell: emulation, boxes and function-block controller together, and the summary of the run."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dtwin import __version__
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS
from dtwin.controller.settings import ControlSettings
from dtwin.emulation import MODEL_FILE, Emulation, Fault, NoiseKind
from dtwin.parameters import PERIOD, PHYSICS_STEP, VOLTAGE_LIMIT, ArmParameters, Triple
from dtwin.run.loop import Controller, Pacer, run, tick_count
from dtwin.run.recording import Log, RunLog
from dtwin.signals import BoxCounts


@dataclass(frozen=True, slots=True)
class CellSettings:
    """The settings of a run; equal settings give equal logs, byte by byte.

    Attributes:
        duration: plant time of the run, s.
        seed: number of the random generators of boxes and noise, which are independent of each other.
        noise: amplitude (uniform) or standard deviation (gaussian) of the encoder noise, rad.
        arm: parameters of the plant; the controller keeps its own model.
        step: integration step of the physics, s; the controller period must be a whole multiple of it.
    """

    duration: float = 120.0
    seed: int = 0
    noise: float = 0.0
    noise_kind: NoiseKind = "uniform"
    faults: tuple[Fault, ...] = ()
    arm: ArmParameters = field(default_factory=ArmParameters)
    control: ControlSettings = field(default_factory=ControlSettings)
    step: float = PHYSICS_STEP
    model_file: Path = MODEL_FILE
    blocks: Path = BLOCKS


class Millimetres(msgspec.Struct, frozen=True):
    max: float
    mean: float


class PerJoint(msgspec.Struct, frozen=True):
    max: Triple


class RunSummary(msgspec.Struct, frozen=True):
    """The summary of a run.

    duration is the plant time run, s; tracking errors are path minus true angle, rad; events counts them by kind.
    """

    duration: float
    seed: int
    boxes: BoxCounts
    placement_error_mm: Millimetres
    tracking_error_rad: PerJoint
    saturated_ticks: int
    real_time_factor: float
    wall_seconds: float
    events: dict[str, int]


def emulate(settings: CellSettings) -> Emulation:
    """The emulated arm and its boxes.

    Raises:
        DtwinError: a setting or the model file cannot be used.
    """
    emulation = Emulation(
        parameters=settings.arm,
        noise=settings.noise,
        noise_kind=settings.noise_kind,
        seed=settings.seed,
        faults=settings.faults,
        model_file=settings.model_file,
        step=settings.step,
    )
    emulation.check_period(PERIOD)
    return emulation


class Cell:
    """One run of the cell. `log` holds what was recorded so far, also after an error or an interruption."""

    def __init__(self, settings: CellSettings, controller: Controller | None = None) -> None:
        """Prepares the run.

        Args:
            settings: settings of the run.
            controller: another controller than the embedded function blocks.

        Raises:
            DtwinError: a setting, the model file or the function blocks cannot be used.
        """
        self.ticks = tick_count(settings.duration)
        self.settings = settings
        self.controller = controller or EmbeddedController(settings.control, settings.blocks)
        self.emulation = emulate(settings)
        self.log = RunLog(metadata(settings))
        self._wall = 0.0

    def run(self, between: Callable[[int], bool] | None = None, realtime: bool = False) -> None:
        """Runs to the end, or until `between` returns False.

        Args:
            between: called with the number of ticks done after every second of plant time.
            realtime: whether to run no faster than real time.

        Raises:
            DtwinError: plant or controller failed.
        """

        def gather(done: int) -> bool:
            self.log.add_events(self.emulation.drain_events())
            return between is None or between(done)

        began = time.perf_counter()
        pacer = Pacer(PERIOD) if realtime else None
        try:
            run(self.emulation, self.controller, self.ticks, record=self.log.append, between=gather, pacer=pacer)
        finally:
            self._wall = time.perf_counter() - began
            self.log.add_events(self.emulation.drain_events())

    def summary(self, log: Log) -> RunSummary:
        """The summary of the run from its frozen log and what became of the boxes."""
        errors = np.array(self.emulation.placement_errors_mm or [0.0])
        duration = len(log) * PERIOD
        tracking = np.abs(log.stack("target") - log.stack("theta")).max(axis=0, initial=0.0).tolist()
        saturated = (np.abs(log.stack("volts")[:, :3]) >= VOLTAGE_LIMIT).any(axis=1)
        return RunSummary(
            duration=round(duration, 9),
            seed=self.settings.seed,
            boxes=self.emulation.box_counts,
            placement_error_mm=Millimetres(float(errors.max()), float(errors.mean())),
            tracking_error_rad=PerJoint(tuple(tracking)),
            saturated_ticks=int(saturated.sum()),
            real_time_factor=duration / self._wall if self._wall else 0.0,
            wall_seconds=self._wall,
            events=dict(sorted(Counter(event.kind for event in log.events).items())),
        )


def metadata(settings: CellSettings) -> dict[str, Any]:
    """The metadata of a log: the settings that the run was made with."""
    return {
        "version": __version__,
        "seed": settings.seed,
        "noise": settings.noise,
        "noise_kind": settings.noise_kind,
        "faults": [str(fault) for fault in settings.faults],
        "arm": asdict(settings.arm),
        "control": asdict(settings.control),
        "step": settings.step,
    }

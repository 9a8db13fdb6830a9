"""The emulated arm and its boxes for the settings of a run."""

from __future__ import annotations

from dtwin.emulation.emulation import Emulation
from dtwin.parameters import PERIOD
from dtwin.run.settings import CellSettings


def emulate(settings: CellSettings) -> Emulation:
    """The emulated arm and its boxes.

    Raises:
        DtwinError: a setting or the model file cannot be used.
    """
    emulation = Emulation(
        parameters=settings.arm,
        machine=settings.machine,
        noise=settings.noise,
        noise_kind=settings.noise_kind,
        seed=settings.seed,
        faults=settings.faults,
        model_file=settings.model_file,
        step=settings.step,
        task=settings.task,
    )
    emulation.check_period(PERIOD)
    return emulation

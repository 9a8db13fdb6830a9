"""A digital twin of a box-sorting arm controlled by IEC 61499 function blocks.

The names below are what notebooks and scripts use; docs/api.md tells all about them.
"""

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dtwin.api.arm.health import commission_arm as commission_arm
    from dtwin.api.arm.health import monitor_arm as monitor_arm
    from dtwin.api.arm.identification import IdentifiedArm as IdentifiedArm
    from dtwin.api.arm.identification import identify_arm as identify_arm
    from dtwin.api.arm.live import LiveArm as LiveArm
    from dtwin.api.arm.live import connect_arm as connect_arm
    from dtwin.api.arm.margins import margins_arm as margins_arm
    from dtwin.api.arms import optimise_arm as optimise_arm
    from dtwin.api.arms import run_arm as run_arm
    from dtwin.api.arms import simulate_arm as simulate_arm
    from dtwin.api.arms import write_fmu_arm as write_fmu_arm
    from dtwin.api.cell import Cell as Cell
    from dtwin.api.commissioning import commission as commission
    from dtwin.api.commissioning import commission_live as commission_live
    from dtwin.api.experiment import identify_experiment as identify_experiment
    from dtwin.api.health import servo_health as servo_health
    from dtwin.api.identification import Identified as Identified
    from dtwin.api.identification import identify as identify
    from dtwin.api.kept.history import history as history
    from dtwin.api.kept.models import compare_models as compare_models
    from dtwin.api.kept.models import export_model as export_model
    from dtwin.api.kept.models import model as model
    from dtwin.api.kept.models import models as models
    from dtwin.api.live import LiveCell as LiveCell
    from dtwin.api.live import connect as connect
    from dtwin.api.margins import margins as margins
    from dtwin.api.measurements import from_arrays as from_arrays
    from dtwin.api.measurements import identify_chain as identify_chain
    from dtwin.api.measurements import read_arm as read_arm
    from dtwin.api.measurements import read_log as read_log
    from dtwin.api.measurements import write_log as write_log
    from dtwin.api.monitoring import Monitored as Monitored
    from dtwin.api.monitoring import compare_with_simulation as compare_with_simulation
    from dtwin.api.monitoring import monitor as monitor
    from dtwin.api.optimisation import optimise as optimise
    from dtwin.api.run import Run as Run
    from dtwin.api.run import RunError as RunError
    from dtwin.api.run import load as load
    from dtwin.api.simulation import simulate as simulate
    from dtwin.api.simulation import simulate_log as simulate_log
    from dtwin.api.simulation import vary as vary
    from dtwin.controller.settings import usual_gains as usual_gains
    from dtwin.errors import DtwinError as DtwinError
    from dtwin.parameters import ArmParameters as ArmParameters
    from dtwin.parameters import Gains as Gains

__version__ = "0.1.0"

# The matrices here are small: threads of linear algebra would only wait for each other. Libraries read this when they
# are loaded, and processes that are started inherit it.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

_MODULES = {
    "Cell": "api.cell",
    "Run": "api.run",
    "RunError": "api.run",
    "load": "api.run",
    "identify": "api.identification",
    "Identified": "api.identification",
    "identify_experiment": "api.experiment",
    "identify_arm": "api.arm.identification",
    "IdentifiedArm": "api.arm.identification",
    "run_arm": "api.arms",
    "simulate_arm": "api.arms",
    "optimise_arm": "api.arms",
    "margins_arm": "api.arm.margins",
    "monitor_arm": "api.arm.health",
    "commission_arm": "api.arm.health",
    "write_fmu_arm": "api.arms",
    "identify_chain": "api.measurements",
    "read_arm": "api.measurements",
    "read_log": "api.measurements",
    "from_arrays": "api.measurements",
    "write_log": "api.measurements",
    "monitor": "api.monitoring",
    "compare_with_simulation": "api.monitoring",
    "Monitored": "api.monitoring",
    "commission": "api.commissioning",
    "commission_live": "api.commissioning",
    "servo_health": "api.health",
    "history": "api.kept.history",
    "models": "api.kept.models",
    "model": "api.kept.models",
    "compare_models": "api.kept.models",
    "export_model": "api.kept.models",
    "simulate": "api.simulation",
    "simulate_log": "api.simulation",
    "vary": "api.simulation",
    "margins": "api.margins",
    "optimise": "api.optimisation",
    "connect": "api.live",
    "connect_arm": "api.arm.live",
    "LiveArm": "api.arm.live",
    "LiveCell": "api.live",
    "ArmParameters": "parameters",
    "Gains": "parameters",
    "usual_gains": "controller.settings",
    "DtwinError": "errors",
}
"""Where the public names are; a module is loaded when one of its names is first used."""
__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'dtwin' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"dtwin.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

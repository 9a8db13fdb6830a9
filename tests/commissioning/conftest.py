"""A short log, and the long computations of a commissioning done once, on few segments and choices, and counted."""

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from dtwin.commissioning import procedure
from dtwin.identification.machine import fit, judged
from dtwin.logs.log import Log
from dtwin.monitoring import calibration
from dtwin.simulation import proposal
from dtwin.simulation.margins import design
from dtwin.simulation.margins.poses import places


@pytest.fixture(scope="module")
def calls() -> Iterator[Counter[str]]:
    """How often each of the long computations was asked for; all are asked the same in this room."""
    counted: Counter[str] = Counter()
    found: dict[str, Any] = {}

    def once(name: str, compute: Callable[..., Any]) -> Callable[..., Any]:
        def counting(*arguments: Any) -> Any:
            counted[name] += 1
            if name not in found:
                found[name] = compute(*arguments)
            return found[name]

        return counting

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judged, "FEWEST", 3)
        patch.setattr(judged, "MOST", 3)
        patch.setattr(judged, "_MOST_JUDGED", 2)
        patch.setattr(fit, "_ROUNDS", 1)
        patch.setattr(judged, "HELD_OUT", 0.5)
        patch.setattr(design, "POSITION_POLES", (9.0,))
        patch.setattr(design, "VELOCITY_POLES", (15.0,))
        patch.setattr(proposal, "poses", places)
        for name in ("COMPLIANCES", "DISPLACEMENTS", "STICKING", "MEMORIES"):
            patch.setattr(calibration, name, getattr(calibration, name)[:1])
        for name in ("check_sensors", "identify_machine", "propose", "watched"):
            patch.setattr(procedure, name, once(name, getattr(procedure, name)))
        yield counted


@pytest.fixture(scope="session")
def short_log(run_cell: Callable[..., Log], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "work <b>.parquet"
    run_cell(40.0, 3).write_parquet(path)
    return path

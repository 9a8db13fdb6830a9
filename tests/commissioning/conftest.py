"""A short log, a fit of few segments and a design of few gains, so that a whole commissioning takes seconds."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dtwin.identification.machine import fit, judged
from dtwin.run.recording import Log
from dtwin.simulation import proposal
from dtwin.simulation.margins import design
from dtwin.simulation.margins.poses import places


@pytest.fixture(scope="module", autouse=True)
def few_segments() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judged, "FEWEST", 3)
        patch.setattr(judged, "MOST", 3)
        patch.setattr(judged, "_MOST_JUDGED", 2)
        patch.setattr(fit, "_ROUNDS", 1)
        patch.setattr(judged, "HELD_OUT", 0.5)
        patch.setattr(design, "POSITION_POLES", (9.0,))
        patch.setattr(design, "VELOCITY_POLES", (15.0,))
        patch.setattr(proposal, "poses", places)
        yield


@pytest.fixture(scope="session")
def short_log(run_cell: Callable[..., Log], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "work <b>.parquet"
    run_cell(40.0, 3).write_parquet(path)
    return path

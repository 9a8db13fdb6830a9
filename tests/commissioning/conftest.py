"""A short log and a fit of few segments, so that a whole commissioning takes seconds."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dtwin.identification.machine import fit, judged
from dtwin.run.recording import Log


@pytest.fixture(scope="module", autouse=True)
def few_segments() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judged, "FEWEST", 3)
        patch.setattr(judged, "MOST", 3)
        patch.setattr(judged, "_MOST_JUDGED", 2)
        patch.setattr(fit, "_ROUNDS", 1)
        patch.setattr(judged, "HELD_OUT", 0.5)
        yield


@pytest.fixture(scope="session")
def short_log(run_cell: Callable[..., Log], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "work <b>.parquet"
    run_cell(40.0, 3).write_parquet(path)
    return path

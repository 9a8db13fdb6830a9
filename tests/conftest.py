"""Settings of hypothesis, and runs of the cell that several tests look at, made once."""

import gc
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import pytest
from hypothesis import settings

from dtwin.emulation.faults import parse_fault
from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import Belief
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from evidence.monitoring.trial import identified_belief
from tests.support.examples import EXAMPLES, THOROUGH, USUAL, usual
from tests.support.scheduling import Scheduling, give_way

# No deadline, since a first call may compile; the same examples every time.
settings.register_profile(USUAL, deadline=None, derandomize=True, max_examples=usual(EXAMPLES))
settings.register_profile(THOROUGH, deadline=None, derandomize=True, max_examples=EXAMPLES)
settings.load_profile(USUAL)

NOISE = 0.003


def pytest_configure() -> None:
    """Lets workers that fill gaps give way to the others; nothing that is collected is rubbish."""
    give_way()
    gc.disable()


def pytest_collection_finish() -> None:
    """Collects rubbish from now on, among what the tests make: the modules and the tests themselves stay."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Scheduling:
    """Hands files to workers."""
    return Scheduling(config, log)


@pytest.fixture(scope="session", autouse=True)
def compiled_modules() -> Iterator[None]:
    """Lets the many processes that tests start keep modules compiled, even where this one does not."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
        yield


@pytest.fixture(scope="session", autouse=True)
def own_runtime_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keeps tests apart from the cells that their user has up."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        yield


@cache
def _log(duration: float, seed: int, faults: tuple[str, ...], step: float, noise: float) -> Log:
    parsed = tuple(parse_fault(fault) for fault in faults)
    cell = Cell(CellSettings(duration, seed, noise, faults=parsed, step=step))
    cell.run()
    return cell.log.freeze()


@pytest.fixture(scope="session")
def run_cell() -> Callable[..., Log]:
    """run_cell(duration, seed, *faults): the log of a cell with noise (rad)."""

    def run(duration: float = 60.0, seed: int = 3, *faults: str, step: float = 0.0025, noise: float = NOISE) -> Log:
        return _log(duration, seed, faults, step, noise)

    return run


@pytest.fixture(scope="session")
def belief() -> Belief:
    """A model from one identification run at that noise."""
    return identified_belief(NOISE, "uniform", 1)

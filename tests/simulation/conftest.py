from __future__ import annotations

import pytest

from dtwin.simulation.checks import Checker
from dtwin.simulation.whatif import Simulator


@pytest.fixture(scope="session")
def simulator() -> Simulator:
    return Simulator()


@pytest.fixture(scope="session")
def checker() -> Checker:
    return Checker()

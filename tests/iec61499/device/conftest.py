"""One management session with each of the two devices."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from iec61499.management.client import ManagementClient
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.iec61499.served_device import PATIENCE
from tests.support.waiting import connected

NEEDS_FORTE = pytest.mark.skipif(not FORTE, reason=NO_FORTE)


@pytest.fixture(params=["embedded", pytest.param("forte", marks=NEEDS_FORTE)])
def either(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ManagementClient]:
    """A management session with the embedded device, then with a 4diac FORTE."""
    if request.param == "embedded":
        with request.getfixturevalue("served").client() as client:
            yield client
        return
    with forte(tmp_path) as address, connected(lambda: ManagementClient(address, PATIENCE)) as client:
        yield client

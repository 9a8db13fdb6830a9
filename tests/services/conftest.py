"""The desk of every test of services, services without one, and a secured cell's router."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from dtwin.bus.opening import open_configured
from tests.support.by_hand import ByHand
from tests.support.desk import Desk, new_desk
from tests.support.secured import certify, copy_secured


@pytest.fixture
def desk() -> Iterator[Desk]:
    with new_desk() as desk:
        yield desk


@pytest.fixture
def sockets() -> Iterator[str]:
    """A folder for sockets, whose path must be short."""
    with TemporaryDirectory() as folder:
        yield folder


@pytest.fixture
def by_hand() -> Iterator[ByHand]:
    cell = ByHand()
    yield cell
    cell.close()


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The shipped configuration at a free port, with certificates, and its router running."""
    folder = tmp_path_factory.mktemp("secured")
    copy_secured(folder)
    certify(folder / "certificates", "stranger")
    certify(folder / "other")
    router = open_configured(folder, "router")
    yield folder
    router.close()

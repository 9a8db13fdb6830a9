"""What the tests of one run share: which runtime executes the blocks, and the libraries, which may be measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.net.address import parse_stream_address
from iec61499.testing.coverage import CoveredLibrary, Measured


@dataclass
class Session:
    """The settings of a run of tests.

    Attributes:
        runtime: `embedded`, `native`, or the address of a device.
        covered: whether it is measured what the tests execute.
        blocks: folder of the block types; None for that of each test.
        opened: ends what the test that runs has opened.
    """

    runtime: str = "embedded"
    covered: bool = False
    blocks: Path | None = None
    opened: list[Callable[[], None]] = field(default_factory=list)
    _libraries: dict[Path, Library] = field(default_factory=dict)
    _client: ManagementClient | None = None

    @property
    def is_device(self) -> bool:
        """Whether the blocks run on a device, not in this process."""
        return self.runtime not in ("embedded", "native")

    def library(self, folder: Path) -> Library:
        """The library of a folder, read once. Raises FunctionBlockError."""
        chosen = (self.blocks or folder).resolve()
        if chosen not in self._libraries:
            self._libraries[chosen] = CoveredLibrary([chosen]) if self.covered else Library([chosen])
        return self._libraries[chosen]

    def client(self) -> ManagementClient:
        """The session with the device: one for all tests, as a 4diac FORTE has one client at a time.

        Raises:
            CommunicationError: nobody answers at the address.
        """
        if self._client is None:
            self._client = ManagementClient(parse_stream_address(self.runtime)).attended()
        elif self._client.lost:
            self._client.reconnect()
        return self._client

    def end(self) -> None:
        """Ends the session with the device, if there is one."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def close(self) -> None:
        """Ends what the test has opened."""
        opened, self.opened = self.opened, []
        for close in opened:
            close()

    def measured(self) -> dict[str, Measured]:
        """What was executed, by the file of each type."""
        found: dict[str, Measured] = {}
        for library in self._libraries.values():
            for measured in library.measured.values() if isinstance(library, CoveredLibrary) else ():
                known = found.setdefault(measured.block.header.file, measured)
                if known is not measured and measured.hits:
                    known.add(measured.hits)
        return dict(sorted(found.items()))


current = Session()
"""The session of the tests that run in this process."""

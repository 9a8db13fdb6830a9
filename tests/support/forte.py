"""A 4diac FORTE as a process; tests with one run where the environment says where it is."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

from iec61499.net.address import LOOPBACK, Address
from tests.support.ports import free_port, listening
from tests.support.waiting import until

FORTE: Final = os.environ.get("FORTE", "")
NO_FORTE: Final = "set FORTE to the path of a 4diac FORTE binary, built as docs/forte.md says, to run this"
FORTE_NATIVE: Final = os.environ.get("FORTE_NATIVE", "")
NO_FORTE_NATIVE: Final = (
    "set FORTE_NATIVE to the path of a 4diac FORTE binary, built with what `dtwin fb export --format forte` writes "
    "as docs/forte.md says, to run this; several paths with : between them"
)
FORTE_OPCUA: Final = os.environ.get("FORTE_OPCUA", "")
NO_FORTE_OPCUA: Final = (
    "set FORTE_OPCUA to the path of a 4diac FORTE binary, built with FORTE_COM_OPC_UA as docs/connections.md says, "
    "to run this"
)
FORTES: Final = (
    pytest.param(FORTE, id="forte", marks=pytest.mark.skipif(not FORTE, reason=NO_FORTE)),
    *(
        pytest.param(path, id=f"native{number}", marks=pytest.mark.skipif(not path, reason=NO_FORTE_NATIVE))
        for number, path in enumerate(FORTE_NATIVE.split(":"), 1)
    ),
)
"""Parameters for `forte`: the binaries that take the application's types as Lua or have them built in."""


@contextmanager
def forte(folder: Path, *arguments: str, port: int | None = None, binary: str = FORTE) -> Iterator[Address]:
    """A FORTE that listens at its management port, a free one if none is given.

    What it prints goes to forte.log in the folder.
    """
    address = Address(LOOPBACK, port or free_port())
    with (folder / "forte.log").open("w") as log:
        command = [binary, "-c", f"localhost:{address.port}", *arguments]
        # SIGPIPE stays ignored: a FORTE does not ignore it by itself, and ends with a client that goes too early
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, cwd=folder, restore_signals=False)
        try:
            # not by connecting: a FORTE refuses the next client until it has noticed that this one has gone
            until(lambda: f"tcp:{address.port}" in listening(process.pid), "the FORTE listens")
            yield address
        finally:
            # a FORTE that has killed a resource no longer ends on SIGTERM
            process.kill()
            process.wait()

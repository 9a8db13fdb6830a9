"""Where a cell that is up on this machine can be found: a locked file in the user's runtime folder."""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Final, Literal

import msgspec

from dtwin.bus.opening import open_configured, open_peer
from dtwin.bus.session import Bus
from dtwin.bus.signature import KEY, read_key
from dtwin.errors import CommunicationError
from dtwin.names import check_name

OPERATOR: Final = "operator"
"""Name of the configuration file of those who command and watch."""
SUPERVISOR: Final = "supervisor"
"""Name of the configuration file of `dtwin up`, where it is another one."""


_LOOKS: Final = 3
"""Number of looks at a file that may be written just now."""
_PAUSE: Final = 0.01
"""s between two looks"""


LINE: Final = "line"
"""Name of what stands in the place of an arm in the keys of a line, and of the configuration file of its service."""


class Up(msgspec.Struct, frozen=True):
    """A cell that is up: its supervisor's process, how to join its bus, where its controller is managed, whether all
    services were ready, the page that shows it, if any, the page of its operators, if any, what its user was warned
    of, if anything, the files of its settings' history and of its identified models, the file of the cell, if one was
    given, how far the services are that are not ready, and whether its arm is another one than the thesis's."""

    pid: int
    arm: str
    meet: str
    zenoh: str | None
    controller: str
    ready: bool = False
    page: str = ""
    console: str = ""
    warning: str = ""
    history: str = ""
    store: str = ""
    cell_file: str = ""
    progress: str = ""
    other: bool = False


def folder() -> Path:
    """The user's own folder for files that need not outlive the session."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    path = Path(base) / "dtwin" if base else Path(tempfile.gettempdir()) / f"dtwin-{os.getuid()}"
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = path.lstat()
    if found.st_uid != os.getuid() or not stat.S_ISDIR(found.st_mode):
        raise CommunicationError(f"{path}: belongs to another user; set XDG_RUNTIME_DIR to a folder of your own")
    if found.st_mode & 0o077:
        path.chmod(0o700)
    return path


class RunFile:
    """Holds the file of a cell while it is up.

    Raises:
        CommunicationError: a cell of that name is up already.
    """

    def __init__(self, cell: str) -> None:
        self.path = _path(cell)
        self._file = self.path.open("a+")
        if not _lock(self._file):
            raise CommunicationError(f"cell {cell!r} is up already: stop it with `dtwin down`, or choose --cell NAME")

    def __enter__(self) -> RunFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        key_of(self.path).unlink(missing_ok=True)
        self.path.unlink(missing_ok=True)
        self._file.close()

    def write_key(self, key: bytes) -> None:
        """Keeps the cell's key in a file of its own, which nobody but this user can read."""
        path = key_of(self.path)
        path.unlink(missing_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(f"{key.hex()}\n")

    def write(self, content: Up) -> None:
        """Tells where the cell is."""
        self._file.truncate(0)
        self._file.write(msgspec.json.encode(content).decode())
        self._file.flush()


def find(cell: str) -> Up | None:
    """The cell of that name if it is up.

    What a killed cell has left is in the file until the next one, which holds it already, says where it is.
    """
    for _ in range(_LOOKS):
        try:
            with _path(cell).open() as file:
                if _lock(file):
                    return None
                up = msgspec.json.decode(file.read(), type=Up)
            os.kill(up.pid, 0)
        except OSError:
            return None
        except msgspec.MsgspecError:
            time.sleep(_PAUSE)
        else:
            return up
    return None


def require(cell: str) -> Up:
    """The cell of that name.

    Raises:
        CommunicationError: it is not up.
    """
    up = find(cell)
    if up is None:
        raise CommunicationError(f"cell {cell!r} is not up on this machine: start it with `dtwin up`")
    return up


def wait_down(cell: str, timeout: float) -> bool:
    """Whether the cell has gone within `timeout` s."""
    deadline = time.monotonic() + timeout
    while find(cell) is not None:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def _path(cell: str) -> Path:
    """The run file of a cell.

    Raises:
        ParameterError: the cell cannot have this name.
    """
    return folder() / f"{check_name(cell, 'cell')}.json"


def _lock(file: IO[str]) -> bool:
    """Whether the lock could be had, which it cannot while another process holds the file."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def has_other_arm(cell: str, zenoh: Path | None) -> bool:
    """Whether a cell has another arm than the thesis's; one on another machine, of a configuration file, has not."""
    up = find(cell) if zenoh is None else None
    return up is not None and up.other


def kept(cell: str, what: Literal["history", "store"], otherwise: Path) -> Path:
    """Where a cell that is up on this machine keeps something; for one that is not, what else there is.

    Args:
        cell: name of the cell.
        what: the history of its settings, or its identified models.
        otherwise: usual file or folder, in the working directory.
    """
    up = find(cell)
    return Path(getattr(up, what)) if up is not None and getattr(up, what) else otherwise


def join(cell: str, zenoh: Path | None = None, name: str = OPERATOR, arm: str = "arm") -> Bus:
    """The bus of a cell: as a configuration file says, or of one that is up on this machine.

    The bus has the cell's key if this user has: from the environment variable DTWIN_KEY, or from the file that
    `dtwin up` keeps on this machine.

    Args:
        cell: name of the cell.
        zenoh: Zenoh configuration file, or a folder with one for each name; None for a cell on this machine.
        name: name of the configuration file in such a folder.
        arm: name of the arm, for a cell elsewhere.

    Raises:
        ParameterError: cell or arm cannot have this name, or what should be the key is none.
        CommunicationError: it is not up, or its bus cannot be joined.
    """
    if zenoh is not None:
        check_name(cell, "cell")
        check_name(arm, "arm")
        return Bus(open_configured(zenoh, name), cell, arm, _key(cell))
    up = require(cell)
    session = open_configured(Path(up.zenoh), name) if up.zenoh else open_peer(up.meet)
    return Bus(session, cell, up.arm, _key(cell))


def join_line(name: str, zenoh: Path | None = None, role: str = OPERATOR) -> Bus:
    """The bus of a line, as that of a cell.

    Raises:
        ParameterError: it cannot have this name, or what should be the key is none.
        CommunicationError: it is not up, it is a cell, or its bus cannot be joined.
    """
    if zenoh is None:
        up = find(check_name(name, "line"))
        if up is None or up.arm != LINE:
            raise CommunicationError(f"line {name!r} is not up on this machine: start it with `dtwin line up`")
    return join(name, zenoh, role, LINE)


def ready(up: Up) -> Up:
    """The same of what is ready now."""
    return msgspec.structs.replace(up, ready=True, progress="")


def _key(cell: str) -> bytes | None:
    """The key of a cell: from the environment, or of one that is up on this machine; None if this user has none."""
    digits = os.environ.get(KEY)
    if digits is not None:
        return read_key(digits, KEY)
    path = key_of(_path(cell))
    try:
        return read_key(path.read_text().strip(), str(path)) if find(cell) is not None else None
    except OSError:
        return None


def key_of(file: Path) -> Path:
    """The file beside the cell's run file with the key of the cell."""
    return file.with_suffix(".key")


def output_of(cell: str) -> Path:
    """The file of what a cell in the background says."""
    return _path(cell).with_suffix(".log")


def journal_of(file: Path) -> Path:
    """The emulator's journal beside the cell's run file."""
    return file.with_suffix(".journal")


def heard_of(file: Path) -> Path:
    """The folder beside the cell's run file in which the monitor keeps what it hears."""
    return file.with_suffix(".heard")


def sockets_of(file: Path) -> Path:
    """The folder beside the cell's run file in which the embedded controller listens."""
    return file.with_suffix(".ports")


def state_of(file: Path) -> Path:
    """The file beside the cell's run file in which the bridge keeps the settings in force."""
    return file.with_suffix(".settings")


@contextmanager
def own_folder(path: Path) -> Iterator[None]:
    """An empty folder that only this user may enter, and that is gone afterwards."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(mode=0o700)
    try:
        yield
    finally:
        shutil.rmtree(path, ignore_errors=True)

"""Tasks of campaigns: one that is in hand when its worker is killed, and some that fail."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

from dtwin.errors import DivergenceError

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def killing(folder: Path, function: Callable[[T], R], victim: T) -> Iterator[Callable[[T], R]]:
    """The function, but the first worker that begins the victim is killed while it has it.

    Args:
        folder: folder of this test.
        function: what is done with an item.
        victim: the item.
    """
    os.mkfifo(folder / "worker")

    def kill() -> None:
        os.kill(int((folder / "worker").read_text()), signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    yield partial(_held_once, folder, function, victim)
    killer.join()


def _held_once(folder: Path, function: Callable[[T], R], victim: T, item: T) -> R:
    if item == victim and _first(folder / "begun"):
        (folder / "worker").write_text(str(os.getpid()))
        threading.Event().wait()
    return function(item)


def _first(path: Path) -> bool:
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def work(seed: int) -> bytes:
    """The log of a second of the cell."""
    from dtwin.run.cell import Cell  # most tasks here do without
    from dtwin.run.settings import CellSettings

    cell = Cell(CellSettings(duration=1.0, seed=seed, noise=0.001))
    cell.run()
    return b"".join(column.tobytes() for column in cell.log.freeze().columns.values())


def die(number: int) -> int:
    """Takes its process with it, unless the number is even."""
    if number % 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def invert(number: int) -> float:
    """One over a number; below 0 it diverges, with an error that cannot be copied to another process."""
    if number < 0:
        raise DivergenceError("the task", 1.0, [float(number)])
    return 1 / number

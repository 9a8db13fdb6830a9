"""A line of many arms, as the text of a file: zones behind one another, each with four stations and two vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

STATIONS: Final = 4
MOST: Final = 4
"""Most zones: each does two of the eight operations that blocks can be given."""
_PLACES: Final = ("blue", "red", "green")
_PITCH: Final = 12.0
"""Distance from one zone to the next, m."""
_NODES: Final = 10


def wide_line(zones: int) -> str:
    """The text of a line file with this number of zones, from 1 to `MOST`."""
    names = [chr(ord("a") + k) for k in range(zones)]
    operations = [f"step{k + 1}" for k in range(2 * zones)]
    lines = ["[operations]", *(f'{name} = {{ place = "{_PLACES[k % 3]}" }}' for k, name in enumerate(operations))]
    lines += ["[assignment]", *(f'{name} = "{names[k // 2]}{k % 2 + 1}"' for k, name in enumerate(operations))]
    lines += ["[source]", 'node = "source"', "every = 24.0", "[sink]", 'node = "sink"']
    for k in range(zones - 1):
        lines += ["[[buffers]]", f'exit = "buffer{k}"', f'entry = "buffer{k}"', "capacity = 3"]
    for k, name in enumerate(names):
        entry = f"buffer{k - 1}" if k else "source"
        exit_ = f"buffer{k}" if k < zones - 1 else "sink"
        lines += _zone(name, k, (entry, exit_), operations[2 * k : 2 * k + 2])
    return "\n".join(lines) + "\n"


def _zone(name: str, number: int, ends: tuple[str, str], operations: list[str]) -> Iterator[str]:
    """A ring of one-way segments, with docks for its ends, stations and vehicles beside it."""
    x = _PITCH * number
    half = _NODES // 2
    ring = ">".join([*(f"n{k + 1}" for k in range(_NODES)), "n1"])
    docks = [ends[0], "s1", "s2", "s3", ends[1], "s4", "home1", "home2"]
    yield f"[zones.{name}]"
    beside = ", ".join(f'"n{k + 1}<>{dock}"' for k, dock in enumerate(docks))
    yield f'segments = ["{ring}", {beside}]'
    yield f"[zones.{name}.nodes]"
    for k in range(_NODES):
        along = k if k < half else _NODES - 1 - k
        yield f"n{k + 1} = [{x + 2.0 * along}, {0.0 if k < half else -1.5}]"
    for k, dock in enumerate(docks):
        along = k if k < half else _NODES - 1 - k
        yield f"{dock} = [{x + 2.0 * along}, {1.5 if k < half else -3.0}]"
    able = ", ".join(f'"{operation}"' for operation in operations)
    for k in range(STATIONS):
        seed = STATIONS * number + k + 1
        yield f'[zones.{name}.stations.{name}{k + 1}]\nnode = "s{k + 1}"\noperations = [{able}]\nseed = {seed}'
    for k in range(2):
        speeds = "speed = 2.0\nacceleration = 1.0\nhandling = 1.0"
        yield f'[zones.{name}.vehicles.{name}_agv{k + 1}]\nhome = "home{k + 1}"\n{speeds}'

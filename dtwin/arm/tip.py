"""Where the chain of an arm ends when nobody says it: at the end of its longest chain, or where its fingers begin."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

Node = TypeVar("Node", int, str)
Path = Sequence[tuple[Node, int]]
"""The links from the base to an end, each with the number of joints that move it."""


def ends_of(longest: Sequence[Path[Node]]) -> list[Node]:
    """The links at which the chain may end, each once.

    Chains that part only after more than half of their joints are the fingers of one hand: they end where they part.

    Args:
        longest: the chains with the most joints.
    """
    return list(dict.fromkeys(_end(path, longest) for path in longest))


def _end(path: Path[Node], longest: Sequence[Path[Node]]) -> Node:
    end, most = path[-1]
    forks = [fork for other in longest if other is not path for fork in _fork(path, other) if 2 * fork[1] > most]
    return min(forks, key=lambda fork: fork[1])[0] if forks else end


def _fork(one: Path[Node], other: Path[Node]) -> Iterator[tuple[Node, int]]:
    """The last link that two chains share, if they share one."""
    shared = [mine for mine, theirs in zip(one, other, strict=False) if mine == theirs]
    yield from shared[-1:]


def fingers_begin(end: int | str) -> str:
    """What is said of a chain that ends before the fingers."""
    return f"the chain ends at {end}, where its fingers begin; tip names another link"

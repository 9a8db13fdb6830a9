"""Which variables an algorithm must load before it runs, and which it may have changed after."""

from __future__ import annotations

from dataclasses import dataclass

from iec61499.st import typed
from iec61499.types import ArrayType, StructType


@dataclass(frozen=True, slots=True)
class Accesses:
    """Variables of the block, in declaration order.

    Attributes:
        reads: variables whose value at the start matters: read before they are assigned, or not always assigned.
        writes: variables that are assigned anywhere.
        modified_arrays: arrays and structures among the reads of which elements are assigned.
    """

    reads: tuple[str, ...]
    writes: tuple[str, ...]
    modified_arrays: frozenset[str]


def accesses(algorithm: typed.CheckedAlgorithm) -> Accesses:
    """Definite-assignment analysis over the statements."""
    flow = _Flow()
    end = flow.body(algorithm.body, frozenset())
    stores = [n for n in typed.walk(algorithm.body) if isinstance(n, (typed.Store, typed.For))]
    written = {node.name for node in stores}
    exits = flow.returns if end is None else [*flow.returns, end]
    certain = frozenset.intersection(*exits) if exits else frozenset()
    reads = flow.loads | (written - certain)
    elements = {n.name for n in stores if isinstance(n, typed.Store) and n.indices}
    return Accesses(
        tuple(name for name in algorithm.variables if name in reads),
        tuple(name for name in algorithm.variables if name in written),
        frozenset(n for n in elements & reads if isinstance(algorithm.variables.get(n), ArrayType | StructType)),
    )


def needed_initialisations(stores: typed.Body, body: typed.Body) -> typed.Body:
    """The stores, of those before the body, whose value the body can read."""
    flow = _Flow()
    flow.body(body, frozenset())
    kept: list[typed.Statement] = []
    for store in reversed(stores):
        if isinstance(store, typed.Store) and store.name in flow.loads:
            kept.append(store)
            flow.loads |= {n.name for n in typed.walk(store.value) if isinstance(n, typed.Load | typed.Element)}
    return tuple(reversed(kept))


class _Flow:
    """Walks forward with the set of variables assigned for certain; None behind a jump."""

    def __init__(self) -> None:
        self.loads: set[str] = set()
        self.returns: list[frozenset[str]] = []

    def body(self, body: typed.Body, assigned: frozenset[str]) -> frozenset[str] | None:
        current: frozenset[str] | None = assigned
        for statement in body:
            if current is None:
                break  # unreachable
            current = self._statement(statement, current)
        return current

    def _read(self, node: object, assigned: frozenset[str]) -> None:
        for part in typed.walk(node):
            if isinstance(part, (typed.Load, typed.Element)) and part.name not in assigned:
                self.loads.add(part.name)

    def _statement(self, node: typed.Statement, assigned: frozenset[str]) -> frozenset[str] | None:
        match node:
            case typed.Store(indices=indices, name=name, value=value):
                self._read((indices, value), assigned)
                if not indices:
                    return assigned | {name}
                if name not in assigned:
                    self.loads.add(name)
                return assigned
            case typed.Invoke():
                return assigned
            case typed.If(branches=branches, otherwise=otherwise):
                for branch in branches:
                    self._read(branch.condition, assigned)
                return _merge([*(self.body(b.body, assigned) for b in branches), self.body(otherwise, assigned)])
            case typed.Case(selector=selector, branches=cases, otherwise=otherwise):
                self._read(selector, assigned)
                return _merge([*(self.body(c.body, assigned) for c in cases), self.body(otherwise, assigned)])
            case typed.For(name=name, start=start, stop=stop, step=step, body=body):
                self._read((start, stop, step), assigned)
                self.body(body, assigned | {name})
                return assigned | {name}
            case typed.While(condition=condition, body=body):
                self._read(condition, assigned)
                self.body(body, assigned)
                return assigned
            case typed.Repeat(body=body, condition=condition):
                after = self.body(body, assigned)
                jumps = any(isinstance(n, (typed.Exit, typed.Continue)) for n in typed.walk(body))
                if after is None or jumps:
                    after = assigned
                self._read(condition, after)
                return after
            case typed.Return():
                self.returns.append(assigned)
        return None


def _merge(branches: list[frozenset[str] | None]) -> frozenset[str] | None:
    reachable = [branch for branch in branches if branch is not None]
    return frozenset.intersection(*reachable) if reachable else None

"""Block types and networks for tests, in the short notation of the standard blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from iec61499 import model
from iec61499.files.block_types import split_condition
from iec61499.library import Library
from iec61499.runtime.resource import Resource
from iec61499.standard.notation import interface, variables


class Types(Library):
    """A library with types that no file holds."""

    def __init__(self, *types: model.LibraryElement) -> None:
        super().__init__()
        self._given = {kind.header.name: kind for kind in types}

    def find(self, name: str, file: str = "", line: int = 0) -> model.LibraryElement:
        return self._given.get(name) or super().find(name, file, line)


def chart(
    name: str,
    events: str,
    data: str,
    states: Mapping[str, list[tuple[str, str]]],
    transitions: list[tuple[str, str, str]],
    internals: str = "",
) -> model.BasicFBType:
    """A basic block; states have (Structured Text, output event) actions, transitions (from, condition, to)."""
    ports = interface(events, data)
    inputs = [event.name for event in ports.event_inputs]
    algorithms: list[model.Algorithm] = []
    made = []
    for state, actions in states.items():
        listed = []
        for text, output in actions:
            algorithm = f"A{len(algorithms)}" if text else ""
            if text:
                algorithms.append(model.Algorithm(algorithm, model.Source(text)))
            listed.append(model.ECAction(algorithm, output))
        made.append(model.ECState(state, tuple(listed)))
    arrows = [model.ECTransition(a, b, *split_condition(condition, inputs)) for a, condition, b in transitions]
    return model.BasicFBType(
        model.TypeHeader(name), ports, variables(internals), tuple(made), tuple(arrows), tuple(algorithms)
    )


def network(
    blocks: str,
    events: str = "",
    data: str = "",
    parameters: Mapping[str, str] | None = None,
) -> model.FBNetwork:
    """A network from `A: E_SR; B: E_CTU`, connections `A.EO -> B.CU; ...` and parameters by `BLOCK.INPUT`."""
    given: dict[str, list[model.Parameter]] = {}
    for place, value in (parameters or {}).items():
        block, _, port = place.rpartition(".")
        given.setdefault(block, []).append(model.Parameter(port, value))
    made = []
    for item in filter(str.strip, blocks.split(";")):
        name, _, kind = (part.strip() for part in item.partition(":"))
        made.append(model.Block(name, kind, tuple(given.get(name, ()))))
    return model.FBNetwork(tuple(made), (), connections(events), connections(data))


def connections(text: str) -> tuple[model.Connection, ...]:
    """Connections from `A.EO -> B.CU; C.EO -> D.EI`, each on a line of its own."""
    made = []
    for line, item in enumerate(filter(str.strip, text.split(";")), 1):
        source, _, destination = (part.strip() for part in item.partition("->"))
        made.append(model.Connection(source, destination, line=line))
    return tuple(made)


class Bench:
    """One block under test in a resource: events go in by name, those that come out are listed."""

    def __init__(
        self, kind: str, *types: model.LibraryElement, parameters: Mapping[str, str] | None = None, probe: str = ""
    ) -> None:
        """probe: the types that extra sources give to generic inputs, such as `IN1: INT, IN2: INT`."""
        library = Types(*types)
        found = library.find(kind)
        outputs = [event.name for event in found.interface.event_outputs]
        inputs = [event.name for event in found.interface.event_inputs]
        self.events: list[str] = []
        servers = "; ".join(f"IN_{event}: SUBSCRIBE_0" for event in inputs)
        watchers = "; ".join(f"OUT_{event}: PUBLISH_0" for event in outputs)
        wiring = [f"IN_{event}.IND -> DUT.{event}" for event in inputs]
        wiring += [f"DUT.{event} -> OUT_{event}.REQ" for event in outputs]
        given = {f"DUT.{name}": value for name, value in (parameters or {}).items()}
        for block in [f"IN_{event}" for event in inputs] + [f"OUT_{event}" for event in outputs]:
            wiring.append(f"START.COLD -> {block}.INIT")
            given |= {f"{block}.QI": "TRUE", f"{block}.ID": f"'{block}'"}
        sources, data = [], []
        for item in filter(str.strip, probe.split(",")):
            name, _, type_name = (part.strip() for part in item.partition(":"))
            sources.append(f"SOURCE_{name}: F_MOVE")
            data.append(f"SOURCE_{name}.OUT -> DUT.{name}")
            given[f"SOURCE_{name}.IN"] = f"{type_name}#0" if type_name != "STRING" else "''"
        blocks = "; ".join(["START: E_RESTART", f"DUT: {kind}", servers, watchers, *sources])
        self.resource = Resource(network(blocks, "; ".join(wiring), "; ".join(data), given), library)
        self._probed = {item.partition(":")[0].strip() for item in probe.split(",")}
        for event in outputs:
            self.resource.port(f"OUT_{event}").attach(self._recorder(event))
        self.resource.start()

    def _recorder(self, event: str) -> Callable[[tuple[Any, ...]], None]:
        return lambda _: self.events.append(event)

    def fire(self, event: str, **inputs: Any) -> list[str]:
        """Sets inputs, issues an event, and gives the events that come out at once."""
        for name, value in inputs.items():
            # a connected input gets its value when it is sampled
            self.resource.write(f"SOURCE_{name}.OUT" if name in self._probed else f"DUT.{name}", value)
        self.events.clear()
        self.resource.port(f"IN_{event}").deliver(())
        self.resource.run_until_idle()
        return list(self.events)

    def advance(self, milliseconds: float) -> list[str]:
        """Moves time on, and gives the events that come out meanwhile."""
        self.events.clear()
        self.resource.advance(round(milliseconds * 1e6))
        return list(self.events)

    def __getitem__(self, variable: str) -> Any:
        return self.resource.read(f"DUT.{variable}")

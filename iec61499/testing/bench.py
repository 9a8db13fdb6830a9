"""One block on a bench: its event inputs are functions, its variables attributes."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from iec61499 import model
from iec61499.errors import FunctionBlockError, ToolError, choices
from iec61499.library import Library
from iec61499.literals import format_literal, parse_duration
from iec61499.testing import session
from iec61499.testing.devices import DeviceRuntime
from iec61499.testing.runtimes import EmbeddedRuntime, Issued, NativeRuntime, Runtime

MILLISECOND = 1_000_000
"""ns"""


def duration_of(text: str | float) -> int:
    """A time in ns: seconds as a number, or a literal such as `T#250ms`. Raises ToolError."""
    if not isinstance(text, str):
        return round(text * 1e9)
    found = parse_duration(text.partition("#")[2])
    if found is None:
        raise ToolError(f"{text!r}: expected seconds, or a duration such as T#250ms")
    return found


def value_of(value: Any, kind: model.VariableType) -> Any:
    """A value for a variable: a text for what is no text is read as a literal. Raises FunctionBlockError."""
    texts = getattr(kind, "kind", "") in ("string", "char")
    if isinstance(value, str) and not texts and not isinstance(kind, model.GenericType):
        return model.literal(value, kind)
    return value


class Ports:
    """Ports by their names: `fb.REQ(IN=1)` lets an event happen, `fb.OUT` is a value, `fb.PLUG.REQ()` an adapter's.

    An event output is a number: how often it came in the last call. `fb.IN = 2` sets an input. What Python does not
    allow as a name, or the bench uses itself, is reached by `fb["NAME"]`.
    """

    def __init__(self, bench: Bench, prefix: str = "") -> None:
        self.__dict__["_bench"] = bench
        self.__dict__["_prefix"] = prefix

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return self[name]
        except FunctionBlockError as error:
            raise AttributeError(str(error)) from None

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self.__dict__:
            raise AttributeError(f"{name} is the bench's own: set an input of that name by fb[{name!r}] = ...")
        self[name] = value

    def __getitem__(self, name: str) -> Any:
        return self._bench._port(f"{self._prefix}{name}")

    def __setitem__(self, name: str, value: Any) -> None:
        self._bench._write(f"{self._prefix}{name}", value)


class Bench(Ports):
    """A block that is executed alone, from its initial values on.

    Attributes:
        kind: the type of the block.
        events: the event outputs that came in the last call, in their order.
        issued: the same with the values of their WITH.
    """

    def __init__(self, kind: model.LibraryElement, running: Runtime) -> None:
        super().__init__(self)
        interface = kind.interface
        self.__dict__.update(
            kind=kind,
            events=(),
            issued=(),
            _runtime=running,
            _inputs={event.name for event in interface.event_inputs},
            _outputs={event.name for event in interface.event_outputs},
            _variables={v.name: v.type for v in (*interface.inputs, *interface.outputs)}
            | {v.name: v.type for v in getattr(kind, "internals", ())},
        )

    kind: model.LibraryElement
    events: tuple[str, ...]
    issued: tuple[Issued, ...]

    @property
    def state(self) -> str:
        """The state that the chart of a basic block is in."""
        found: str = self._runtime.read("$ECC")
        return found

    def fire(self, event: str, **inputs: Any) -> tuple[str, ...]:
        """Sets inputs and lets the block have an event; gives the event outputs that come at once.

        Raises:
            FunctionBlockError: there is no such port, a value is not of its type, or the block fails.
        """
        if event not in self._inputs:
            raise FunctionBlockError(f"{self.kind.header.name} has no event input {event!r}: {self._hint(event)}")
        for name, value in inputs.items():
            self._write(name, value)
        self._runtime.fire(event)
        return self._collect()

    def advance(self, duration: str | float) -> tuple[str, ...]:
        """Moves time on; gives the event outputs that come meanwhile.

        Args:
            duration: seconds, or a literal such as `T#250ms`.
        """
        self._runtime.advance(duration_of(duration))
        return self._collect()

    def due(self) -> float | None:
        """How long until the next timed block inside issues its event, s; None when none waits."""
        waiting = self._runtime.due()
        return None if waiting is None else waiting / 1e9

    def wait(self, number: int) -> tuple[str, ...]:
        """Waits until so many event outputs have come that do not come at once, and gives them.

        In simulated time that takes a day at most, on a device, in real time, 5 s.
        """
        self.__dict__["issued"] = self._runtime.wait(number)
        self.__dict__["events"] = tuple(name for name, _ in self.issued)
        return self.events

    def close(self) -> None:
        """Ends it; what it has executed is counted by then."""
        self._runtime.close()

    def _collect(self) -> tuple[str, ...]:
        issued = self._runtime.issued()
        self.__dict__.update(issued=issued, events=tuple(name for name, _ in issued))
        return self.events

    def _port(self, name: str) -> Any:
        if name in self._inputs:

            def fire(**inputs: Any) -> tuple[str, ...]:
                return self.fire(name, **inputs)

            return fire
        if name in self._outputs:
            return self.events.count(name)
        if name in self._variables or name == "$ECC":
            return self._runtime.read(name)
        known = (*self._inputs, *self._outputs, *self._variables)
        if any(other.startswith(f"{name}.") for other in known):
            return Ports(self, f"{name}.")
        if isinstance(self.kind, model.CompositeFBType) and "." in name:
            return self._runtime.read(name)
        if isinstance(self.kind, model.CompositeFBType) and name in [b.name for b in self.kind.network.blocks]:
            return Ports(self, f"{name}.")
        raise FunctionBlockError(f"{self.kind.header.name} has no port {name!r}: {self._hint(name)}")

    def _write(self, name: str, value: Any) -> None:
        kind = self._variables.get(name)
        if kind is None:
            raise FunctionBlockError(f"{self.kind.header.name} has no input {name!r}: {self._hint(name)}")
        self._runtime.write(name, value_of(value, kind))

    def _hint(self, name: str) -> str:
        known = [*self._inputs, *self._outputs, *self._variables]
        close = difflib.get_close_matches(name, known, n=5, cutoff=0.4) or sorted(known)[:20]
        return f"expected {choices(close)}" if close else "it has none"


def bench_of(kind: model.LibraryElement, folder: Path, parameters: Mapping[str, Any]) -> Bench:
    """A block of a library on the runtime of the session; inputs begin with the values given. Raises ToolError."""
    library = session.current.library(folder)
    types = {variable.name: variable.type for variable in kind.interface.inputs}
    literals = {}
    for name, value in parameters.items():
        data_type = types.get(name)
        if data_type is None or isinstance(data_type, model.GenericType):
            valid = choices(types) if types else "none, as it has none"
            raise FunctionBlockError(f"{kind.header.name} has no input {name!r} with a type: expected {valid}")
        literals[name] = format_literal(value_of(value, data_type), data_type)
    made = Bench(kind, _runtime(kind, library, literals))
    session.current.opened.append(made.close)
    return made


def _runtime(kind: model.LibraryElement, library: Library, literals: Mapping[str, str]) -> Runtime:
    """What the session executes blocks with, with the block in it. Raises ToolError."""
    if session.current.runtime == "embedded":
        return EmbeddedRuntime(kind, library, literals)
    if session.current.runtime == "native":
        return NativeRuntime(kind, library, literals)
    return DeviceRuntime(kind, library, literals, session.current.client())


def block(name: str, /, folder: str | Path | None = None, **inputs: Any) -> Bench:
    """A block on a bench.

    Args:
        name: the name of its type.
        folder: where the types are; without it the folder of the file that calls, or the nearest one above it that
            has types.
        inputs: values that inputs have from the beginning; for what is no text a text is read as a literal.

    Raises:
        FunctionBlockError: there is no such type, it is wrong, or an input is.
    """
    where = Path(folder) if folder is not None else caller_folder(sys._getframe(1).f_globals)
    return bench_of(session.current.library(where).find(name), where, inputs)


def caller_folder(caller: Mapping[str, Any]) -> Path:
    """The folder of a test's types: that of its file, or the nearest one above with types."""
    start = Path(caller.get("__file__") or Path.cwd() / "interactive").resolve().parent
    for folder in (start, *list(start.parents)[:3]):
        if any(folder.glob("*.fbt")) or any(folder.glob("*.sys")):
            return folder
    return start

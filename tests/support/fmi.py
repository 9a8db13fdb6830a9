"""FMUs by their C functions, so that a test can call what no simulator would: any function, in any state."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_int32, c_size_t, c_uint32, c_void_p
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from lxml import etree

OK, DISCARD, ERROR = 0, 2, 3
"""The numbers of fmi2Status and fmi3Status."""
PERIOD: Final = 0.01
_LOGGERS: Final = {
    "2.0": ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p, c_char_p),
    "3.0": ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p),
}
_KINDS: Final = {"Real": "Float64", "Integer": "Int32"}
_VALUES: Final[Mapping[str, Any]] = {"Float64": c_double, "Int32": c_int32, "Boolean": c_bool, "String": c_char_p}


class _Callbacks(ctypes.Structure):
    """fmi2CallbackFunctions, its logger with the one text that these FMUs pass."""

    _fields_ = (
        ("logger", _LOGGERS["2.0"]),
        ("allocate", c_void_p),
        ("free", c_void_p),
        ("step_finished", c_void_p),
        ("environment", c_void_p),
    )


@dataclass(frozen=True, slots=True)
class Entry:
    """A variable in modelDescription.xml; its range is None where it names none."""

    name: str
    kind: str
    reference: int
    causality: str
    variability: str
    start: str | None
    low: float | None
    high: float | None

    @property
    def is_set_before_the_start(self) -> bool:
        """Whether it can be set until the initialization ends."""
        return self.causality in ("parameter", "input")


@dataclass(frozen=True, slots=True)
class Message:
    """What an FMU logged."""

    status: int
    category: str
    text: str


class Library:
    """The binary of an unpacked FMU with what its description says."""

    def __init__(self, folder: Path, binary: Path | None = None) -> None:
        root = etree.parse(str(folder / "modelDescription.xml")).getroot()
        self.version = root.get("fmiVersion")
        self.token = root.get("instantiationToken") or root.get("guid")
        self.categories = [category.get("name") for category in root.findall("LogCategories/Category")]
        self.variables = {entry.name: entry for entry in map(_entry, root.find("ModelVariables"))}
        (own,) = folder.glob("binaries/*/*")
        self.functions = ctypes.CDLL(str(binary or own))

    @property
    def is_second(self) -> bool:
        """Whether it is FMI 2.0."""
        return self.version == "2.0"

    def function(self, name: str) -> Any:
        """A function of the interface by its name without `fmi2` or `fmi3`."""
        return getattr(self.functions, f"fmi{self.version[0]}{name}")

    def instantiate(
        self, name: str | None = "arm", token: str | None = None, logging: bool = True, events: bool = False
    ) -> Instance:
        """A new instance, whose handle is None where the FMU refused it."""
        return Instance(self, name, self.token if token is None else token, logging, events)


class Instance:
    """An instance and what it logged."""

    def __init__(self, library: Library, name: str | None, token: str, logging: bool, events: bool) -> None:
        self.library, self.messages = library, list[Message]()
        named = None if name is None else name.encode()
        make = library.function("Instantiate" if library.is_second else "InstantiateCoSimulation")
        make.restype = c_void_p
        if library.is_second:
            self._log = _LOGGERS["2.0"](lambda _, __, status, category, ___, text: self._note(status, category, text))
            self._callbacks = _Callbacks(self._log)
            handle = make(named, 1, token.encode(), None, byref(self._callbacks), 0, int(logging))
        else:
            self._log = _LOGGERS["3.0"](lambda _, status, category, text: self._note(status, category, text))
            flags = (c_bool(False), c_bool(logging), c_bool(events), c_bool(False))
            handle = make(named, token.encode(), None, *flags, None, c_size_t(0), None, self._log, None)
        self.handle: c_void_p | None = None if handle is None else c_void_p(handle)

    def _note(self, status: int, category: bytes, text: bytes) -> None:
        self.messages.append(Message(status, category.decode(), text.decode()))

    @property
    def told(self) -> str:
        """The text of the last message."""
        return self.messages[-1].text

    def call(self, name: str, *arguments: Any) -> int:
        """Calls a function by its name of FMI 3.0, or by what it was called in FMI 2.0; returns its status."""
        if self.library.is_second:
            old = {
                "GetFloat64": "GetReal",
                "SetFloat64": "SetReal",
                "GetInt32": "GetInteger",
                "SetInt32": "SetInteger",
            }
            name = old.get(name, name.replace("FMUState", "FMUstate").replace("Deserialize", "DeSerialize"))
        status: int = self.library.function(name)(self.handle, *arguments)
        return status

    def free(self) -> None:
        self.library.function("FreeInstance")(self.handle)

    # ---- from the beginning to the end ----

    def set_up(self, start: float = 0.0, stop: float | None = None, tolerance: float | None = None) -> int:
        """Says when the experiment is: its own function in FMI 2.0, the begin of the initialization in FMI 3.0."""
        name, flag = ("SetupExperiment", c_int) if self.library.is_second else ("EnterInitializationMode", c_bool)
        given = (flag(tolerance is not None), c_double(tolerance or 0.0), c_double(start))
        return self.call(name, *given, flag(stop is not None), c_double(stop or 0.0))

    def enter(self, start: float = 0.0, stop: float | None = None) -> int:
        """Enters the initialization."""
        status = self.set_up(start, stop)
        return status or (self.call("EnterInitializationMode") if self.library.is_second else OK)

    def begin(self, start: float = 0.0, stop: float | None = None) -> Instance:
        """Does the initialization."""
        assert (self.enter(start, stop), self.call("ExitInitializationMode")) == (OK, OK)
        return self

    def step(self, time: float, duration: float = PERIOD) -> int:
        """Does a step; keeps in FMI 3.0 whether an event is to be handled in `has_event`."""
        if self.library.is_second:
            return self.call("DoStep", c_double(time), c_double(duration), c_int(1))
        event, end, early, reached = c_bool(), c_bool(), c_bool(), c_double()
        places = (byref(event), byref(end), byref(early), byref(reached))
        status = self.call("DoStep", c_double(time), c_double(duration), c_bool(True), *places)
        self.has_event, self.reached = event.value, reached.value
        return status

    def log(self, on: bool, categories: Sequence[str | None] = ()) -> int:
        """Says what is to be logged."""
        names = (c_char_p * len(categories))(*(None if name is None else name.encode() for name in categories))
        flag = c_int if self.library.is_second else c_bool
        return self.call("SetDebugLogging", flag(on), c_size_t(len(categories)), names if categories else None)

    # ---- values ----

    def set(self, **values: Any) -> int:
        """Sets variables of one kind at once; a name has `__` for a dot."""
        entries = [self.library.variables[name.replace("__", ".")] for name in values]
        return self.put(entries[0].kind, [entry.reference for entry in entries], list(values.values()))

    def put(self, kind: str, references: Sequence[int], values: Sequence[Any]) -> int:
        """Sets values of a kind by their references."""
        of = self._type(kind)
        array = (of * len(values))(*(value.encode() if isinstance(value, str) else value for value in values))
        return self.call(f"Set{kind}", *_references(references), array, *self._count(len(values)))

    def get(self, *names: str) -> list[Any]:
        """The values of variables of one kind."""
        entries = [self.library.variables[name] for name in names]
        kind = entries[0].kind
        array = (self._type(kind) * len(names))()
        references = [entry.reference for entry in entries]
        status = self.call(f"Get{kind}", *_references(references), array, *self._count(len(names)))
        assert status == OK, self.messages
        return list(array)

    def _type(self, kind: str) -> Any:
        return c_int if self.library.is_second and kind == "Boolean" else _VALUES[kind]

    def _count(self, count: int) -> tuple[c_size_t, ...]:
        return () if self.library.is_second else (c_size_t(count),)

    # ---- states ----

    def state(self) -> c_void_p:
        """A state that it took."""
        state = c_void_p()
        assert self.call("GetFMUState", byref(state)) == OK
        return state

    def load(self, state: c_void_p) -> int:
        return self.call("SetFMUState", state)

    def packed(self, state: c_void_p | None = None) -> bytes:
        """A state, by default the present one, as bytes."""
        own = self.state() if state is None else state
        size = c_size_t()
        assert self.call("SerializedFMUStateSize", own, byref(size)) == OK
        array = (ctypes.c_char * size.value)()
        assert self.call("SerializeFMUState", own, array, size) == OK
        if state is None:
            assert self.call("FreeFMUState", byref(own)) == OK
        return array.raw

    def unpack(self, packed: bytes) -> tuple[int, c_void_p]:
        """The status of reading bytes, and the state that was read."""
        state = c_void_p()
        return self.call("DeserializeFMUState", packed, c_size_t(len(packed)), byref(state)), state


def _references(references: Sequence[int]) -> tuple[Any, c_size_t]:
    return (c_uint32 * len(references))(*references), c_size_t(len(references))


def _entry(element: etree._Element) -> Entry:
    """A variable of FMI 3.0, or one of FMI 2.0, whose kind is an element of its own."""
    inner = element[0] if element.tag == "ScalarVariable" else element
    text = inner.find("Start")
    low, high = (None if inner.get(end) is None else float(inner.get(end)) for end in ("min", "max"))
    return Entry(
        element.get("name"),
        _KINDS.get(inner.tag, inner.tag),
        int(element.get("valueReference")),
        element.get("causality"),
        element.get("variability"),
        inner.get("start") if text is None else text.get("value"),
        low,
        high,
    )

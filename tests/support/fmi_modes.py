"""In which states the standard allows which function, and how a test calls each.

The tables are transcribed from FMI 2.0.4, section 4.2.4 (states instantiated, Initialization Mode,
stepComplete, terminated, error), and from FMI 3.0.2, "Allowed Function Calls" in sections 2.3 and 4.2.1
(Instantiated, Initialization Mode, Event Mode, Step Mode, Terminated). `x` stands for allowed, `.` for not
allowed, and `d` for allowed with fmi2Discard: a status that cannot be retrieved (4.2.3). What a model without
the capability must refuse is `.` everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from typing import Any, Final

from tests.support.fmi import DISCARD, ERROR, OK, Instance

STATES_2: Final = ("instantiated", "initialization", "step", "terminated", "error")
STATES_3: Final = ("instantiated", "initialization", "event", "step", "terminated")
STATUS: Final = {"x": OK, ".": ERROR, "d": DISCARD}
TABLE_2: Final = """
SetDebugLogging             x x x x x
SetupExperiment             x . . . .
EnterInitializationMode     x . . . .
ExitInitializationMode      . x . . .
Terminate                   . . x . .
Reset                       x x x x x
GetReal                     . x x x x
GetInteger                  . x x x x
GetBoolean                  . x x x x
GetString                   . x x x x
SetReal                     x x x . .
SetInteger                  x x x . .
SetBoolean                  x x x . .
SetString                   x x x . .
GetFMUstate                 x x x x x
SetFMUstate                 x x x x x
FreeFMUstate                x x x x x
SerializedFMUstateSize      x x x x x
SerializeFMUstate           x x x x x
DeSerializeFMUstate         x x x x x
GetDirectionalDerivative    . x x x x
SetRealInputDerivatives     . . . . .
GetRealOutputDerivatives    . . . . .
DoStep                      . . x . .
CancelStep                  . . . . .
GetStatus                   . . d d .
GetRealStatus               . . x x .
GetIntegerStatus            . . d d .
GetBooleanStatus            . . x x .
GetStringStatus             . . d d .
"""
TABLE_3: Final = """
SetDebugLogging                 x x x x x
EnterInitializationMode         x . . . .
ExitInitializationMode          . x . . .
EnterEventMode                  . . . x .
Terminate                       . . x x .
Reset                           x x x x x
GetFloat64                      x x x x x
GetInt32                        x x x x x
GetBoolean                      x x x x x
GetString                       x x x x x
SetFloat64                      x x x x .
SetInt32                        x x x x .
SetBoolean                      x x x x .
SetString                       x x x x .
GetFMUState                     x x x x x
SetFMUState                     x x x x x
FreeFMUState                    x x x x x
SerializedFMUStateSize          x x x x x
SerializeFMUState               x x x x x
DeserializeFMUState             x x x x x
GetDirectionalDerivative        . x x x x
EvaluateDiscreteStates          . . x . .
UpdateDiscreteStates            . . x . .
EnterStepMode                   . . x . .
DoStep                          . . . x .
"""
ABSENT_3: Final = """
GetFloat32 SetFloat32 GetInt8 SetInt8 GetUInt8 SetUInt8 GetInt16 SetInt16 GetUInt16 SetUInt16 GetUInt32
SetUInt32 GetInt64 SetInt64 GetUInt64 SetUInt64 GetBinary SetBinary GetClock SetClock
GetNumberOfVariableDependencies GetVariableDependencies GetAdjointDerivative EnterConfigurationMode
ExitConfigurationMode GetIntervalDecimal GetIntervalFraction GetShiftDecimal GetShiftFraction
SetIntervalDecimal SetIntervalFraction SetShiftDecimal SetShiftFraction GetOutputDerivatives
EnterContinuousTimeMode CompletedIntegratorStep SetTime SetContinuousStates GetContinuousStateDerivatives
GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates GetNumberOfEventIndicators
GetNumberOfContinuousStates ActivateModelPartition
"""
"""What a co-simulation without clocks, structural parameters and other types must refuse in every state."""


def allowed(version: str) -> dict[str, dict[str, int]]:
    """The status of every function in every state of a version: function, then state."""
    states, table = (STATES_2, TABLE_2) if version == "2.0" else (STATES_3, TABLE_3)
    rows = [line.split() for line in table.strip().splitlines()]
    found = {name: dict(zip(states, (STATUS[mark] for mark in marks), strict=True)) for name, *marks in rows}
    absent = [] if version == "2.0" else ABSENT_3.split()
    return found | {name: dict.fromkeys(states, ERROR) for name in absent}


def put(instance: Instance, state: str) -> Instance:
    """Brings a new instance, in FMI 3.0 one with event mode, into a state."""
    if state == "error":
        assert instance.set(**failing(instance)) == OK
    if state == "initialization":
        assert instance.enter() == OK
    elif state != "instantiated":
        instance.begin()
        if not instance.library.is_second and state != "event":
            assert instance.call("EnterStepMode") == OK
    if state == "terminated":
        assert instance.call("Terminate") == OK
    if state == "error":
        assert instance.step(0.0, 60.0) == ERROR
        assert "the motion of the arm is not finite" in instance.told
    return instance


def failing(instance: Instance) -> dict[str, float]:
    """Parameters, all in range, with which the integration of the arm is not stable."""
    prefix = "" if "longest_step" in instance.library.variables else "arm__"
    return {f"{prefix}longest_step": 1.0, f"{prefix}D3": 100.0, f"{prefix}I3": 1e-6}


def arguments(instance: Instance, function: str) -> tuple[Any, ...]:
    """Arguments of a function that are right wherever it may be called."""
    return CALLS.get(function, lambda _: ())(instance)


def _values(kind: str, is_set: bool) -> Callable[[Instance], tuple[Any, ...]]:
    """One variable of a kind, or none where the model has none, and room for its value."""

    def made(instance: Instance) -> tuple[Any, ...]:
        boolean = c_int if instance.library.is_second else c_bool
        types: Mapping[str, Any] = {"Float64": c_double, "Int32": c_int, "String": c_char_p, "Boolean": boolean}
        entries = [
            entry
            for entry in instance.library.variables.values()
            if entry.kind == kind and (not is_set or (entry.is_set_before_the_start and entry.variability != "fixed"))
        ][:1]
        references = (c_uint32 * 1)(*(entry.reference for entry in entries))
        place = (types[kind] * 1)()
        if entries and kind == "String":
            place[0] = b"red"
        elif entries and kind == "Float64" and entries[0].start is not None:
            place[0] = float(entries[0].start)
        size = c_size_t(len(entries))
        return (references, size, place) if instance.library.is_second else (references, size, place, size)

    return made


def _state(instance: Instance) -> tuple[Any, ...]:
    return (instance.state(),)


def _serialize(instance: Instance) -> tuple[Any, ...]:
    size = len(instance.packed())
    return instance.state(), (c_int * size)(), c_size_t(size)


def _deserialize(instance: Instance) -> tuple[Any, ...]:
    packed = instance.packed()
    return packed, c_size_t(len(packed)), byref(c_void_p())


def _set_up(instance: Instance) -> tuple[Any, ...]:
    flag = c_int if instance.library.is_second else c_bool
    return flag(False), c_double(), c_double(), flag(False), c_double()


def _step(instance: Instance) -> tuple[Any, ...]:
    begin = (c_double(0.0), c_double(0.01))
    if instance.library.is_second:
        return *begin, c_int(1)
    return *begin, c_bool(True), byref(c_bool()), byref(c_bool()), byref(c_bool()), byref(c_double())


def _derivative(instance: Instance) -> tuple[Any, ...]:
    variables = instance.library.variables
    unknown, known = ((c_uint32 * 1)(variables[name].reference) for name in ("alpha1", "V1"))
    one = c_size_t(1)
    counts = () if instance.library.is_second else (one,)
    return unknown, one, known, one, (c_double * 1)(1.0), *counts, (c_double * 1)(), *counts


CALLS: Final[Mapping[str, Callable[[Instance], tuple[Any, ...]]]] = {
    "SetDebugLogging": lambda _: (c_int(1), c_size_t(0), None),
    "SetupExperiment": _set_up,
    "EnterInitializationMode": lambda instance: () if instance.library.is_second else _set_up(instance),
    **{f"Get{name}": _values(kind, False) for name, kind in (("Real", "Float64"), ("Integer", "Int32"))},
    **{f"Set{name}": _values(kind, True) for name, kind in (("Real", "Float64"), ("Integer", "Int32"))},
    **{f"Get{kind}": _values(kind, False) for kind in ("Float64", "Int32", "Boolean", "String")},
    **{f"Set{kind}": _values(kind, True) for kind in ("Float64", "Int32", "Boolean", "String")},
    **{f"GetFMU{state}": lambda _: (byref(c_void_p()),) for state in ("state", "State")},
    **{f"SetFMU{state}": _state for state in ("state", "State")},
    **{f"FreeFMU{state}": lambda instance: (byref(instance.state()),) for state in ("state", "State")},
    **{f"SerializedFMU{state}Size": lambda one: (one.state(), byref(c_size_t())) for state in ("state", "State")},
    **{f"SerializeFMU{state}": _serialize for state in ("state", "State")},
    **dict.fromkeys(("DeSerializeFMUstate", "DeserializeFMUState"), _deserialize),
    "GetDirectionalDerivative": _derivative,
    "DoStep": _step,
    "UpdateDiscreteStates": lambda _: (*(byref(c_bool()) for _ in range(5)), byref(c_double())),
    "GetStatus": lambda _: (c_int(0), byref(c_int())),
    "GetRealStatus": lambda _: (c_int(2), byref(c_double())),
    "GetIntegerStatus": lambda _: (c_int(0), byref(c_int())),
    "GetBooleanStatus": lambda _: (c_int(3), byref(c_int())),
    "GetStringStatus": lambda _: (c_int(1), byref(c_char_p())),
}
"""What a function is called with, of those that do more than refuse."""

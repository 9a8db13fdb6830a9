"""Every function of FMI in every state is allowed or refused as the standard's tables say; nothing breaks an FMU."""

from __future__ import annotations

import re
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from pathlib import Path

import pytest

from dtwin.fmu.sources import Subject, Version
from tests.fmu.conftest import Made
from tests.support.fmi import DISCARD, ERROR, OK, Instance, Library
from tests.support.fmi_modes import STATES_2, STATES_3, allowed, arguments, failing, put
from tests.support.iec61499.c_harness import needs_compiler

pytestmark = needs_compiler
VERSIONS: tuple[Version, ...] = ("3.0", "2.0")
IN_STATES = [*(("2.0", state) for state in STATES_2), *(("3.0", state) for state in STATES_3)]


@pytest.fixture
def library(made: Made, version: Version) -> Library:
    return Library(made("twin", version))


@pytest.mark.parametrize(("version", "state"), IN_STATES)
def test_every_function_in_every_state(library: Library, state: str, version: Version) -> None:
    for function, expected in allowed(version).items():
        instance = put(library.instantiate(events=version == "3.0"), state)
        if function == "EnterInitializationMode" and version == "2.0" and state == "instantiated":
            assert instance.set_up() == OK
        given = arguments(instance, function)
        instance.messages.clear()
        before = instance.packed()
        status = getattr(library.functions, f"fmi{version[0]}{function}")(instance.handle, *given)
        assert status == expected[state], function
        if status == OK:
            assert not instance.messages, function
        else:
            assert instance.packed() == before, function
            (message,) = instance.messages
            assert message.status == status
            assert message.text.startswith(f"fmi{version[0]}{function}: "), message
        instance.free()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_table_has_every_function_of_the_standard(version: Version) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install dtwin[test]")
    header = Path(fmpy.__file__).parent / "c-code" / f"fmi{version[0]}Functions.h"
    declared = set(re.findall(rf"fmi{version[0]}([A-Z]\w+)TYPE\s+fmi", header.read_text()))
    made = {"GetVersion", "GetTypesPlatform", "FreeInstance", "Instantiate"}
    made |= {f"Instantiate{kind}" for kind in ("CoSimulation", "ModelExchange", "ScheduledExecution")}
    of_model_exchange = {
        *("EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode", "CompletedIntegratorStep", "SetTime"),
        *("SetContinuousStates", "GetDerivatives", "GetEventIndicators", "GetContinuousStates"),
        "GetNominalsOfContinuousStates",
    }
    assert declared - made - (of_model_exchange if version == "2.0" else set()) == set(allowed(version))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("subject", ["twin", "controller", "cell"])
def test_a_null_instance_is_an_error(made: Made, subject: Subject, version: Version) -> None:
    library = Library(made(subject, version))
    instance = library.instantiate()
    for function in allowed(version):
        if function != "GetDirectionalDerivative":
            given = arguments(instance, function)
            assert getattr(library.functions, f"fmi{version[0]}{function}")(None, *given) == ERROR, function
    library.function("FreeInstance")(None)
    instance.free()


@pytest.mark.parametrize("version", VERSIONS)
def test_null_arguments_are_errors(library: Library, version: Version) -> None:
    instance = library.instantiate(events=version == "3.0").begin()
    if version == "3.0":
        assert instance.call("UpdateDiscreteStates", *[None] * 6) == ERROR
        assert instance.call("EnterStepMode") == OK
        assert instance.call("DoStep", c_double(0.0), c_double(0.01), c_bool(True), *[None] * 4) == ERROR
    else:
        for name in ("GetStatus", "GetRealStatus", "GetBooleanStatus"):
            assert instance.call(name, c_int(2), None) == ERROR
    before = instance.packed()
    one, none, reference, value = c_size_t(1), c_size_t(0), (c_uint32 * 1)(1), (c_double * 1)()
    counted = () if library.is_second else (one,)
    for function in ("GetFloat64", "SetFloat64"):
        assert instance.call(function, None, one, value, *counted) == ERROR
        assert instance.call(function, reference, one, None, *counted) == ERROR
        assert instance.call(function, None, none, None, *(() if library.is_second else (none,))) == OK
    for lacking in range(4):
        arrays = [None if k == lacking else array for k, array in enumerate((reference, reference, value, value))]
        unknown, known, seed, moved = arrays
        derivative = (unknown, one, known, one, seed, *counted, moved, *counted)
        assert instance.call("GetDirectionalDerivative", *derivative) == ERROR
    state = instance.state()
    assert instance.call("GetFMUState", None) == ERROR
    assert instance.call("SetFMUState", None) == ERROR
    assert instance.call("SerializedFMUStateSize", state, None) == ERROR
    assert instance.call("SerializedFMUStateSize", None, byref(c_size_t())) == ERROR
    assert instance.call("SerializeFMUState", state, None, c_size_t(10**6)) == ERROR
    assert instance.call("DeserializeFMUState", None, c_size_t(len(before)), byref(c_void_p())) == ERROR
    assert instance.call("DeserializeFMUState", before, c_size_t(len(before)), None) == ERROR
    assert instance.call("FreeFMUState", None) == OK
    assert instance.call("FreeFMUState", byref(c_void_p())) == OK
    assert instance.packed() == before
    instance.free()


@pytest.mark.parametrize("version", VERSIONS)
def test_an_instance_needs_a_name_and_the_token(library: Library, version: Version) -> None:
    for name, token in ((None, None), ("", None), (" \t", None), ("arm", "{none}"), ("arm", "")):
        instance = library.instantiate(name, token, logging=False)
        assert instance.handle is None
        assert "expected a " in instance.told, "also without logging, as the caller would not know why"
    if version == "2.0":
        make = library.functions.fmi2Instantiate
        assert make(b"arm", 1, library.token.encode(), None, None, 0, 0) is None
    else:
        for kind in ("ModelExchange", "ScheduledExecution"):
            make = library.function(f"Instantiate{kind}")
            make.restype = c_void_p
            assert make(b"arm", library.token.encode(), None, c_bool(False), c_bool(False), *[None] * 5) is None


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("subject", ["twin", "cell"])
def test_a_step_that_fails_is_taken_back(made: Made, subject: Subject, version: Version) -> None:
    """An arm that is not stable ends the run, but no angle is NaN; a state that was taken before goes on."""
    instance = Library(made(subject, version)).instantiate()
    parameters = failing(instance)
    assert instance.set(**{name: parameters[name] for name in parameters if name.endswith("longest_step")}) == OK
    instance.begin()
    tunable = {name: value for name, value in parameters.items() if not name.endswith("longest_step")}
    state = instance.state()
    assert instance.set(**tunable) == OK
    names = ("theta1", "theta2", "theta3", "omega1", "omega2", "omega3")
    before = instance.get(*names)
    assert instance.step(0.0, 60.0) == ERROR
    assert instance.get(*names) == before
    assert instance.step(0.0) == ERROR
    assert "cannot be called after " in instance.told
    assert instance.load(state) == OK
    assert instance.step(0.0) == OK
    instance.free()


@pytest.mark.parametrize("version", VERSIONS)
def test_logging_is_as_asked(library: Library, version: Version) -> None:
    assert library.categories == ["logStatusDiscard", "logStatusError"]

    def logged(instance: Instance) -> list[str]:
        instance.messages.clear()
        assert instance.set(V1=float("nan")) == DISCARD
        assert instance.step(7.0) == ERROR
        return [message.category for message in instance.messages]

    silent, loud = library.instantiate(logging=False).begin(), library.instantiate(logging=True).begin()
    both = library.categories
    assert (logged(silent), logged(loud)) == ([], both)
    assert silent.log(True, ["logStatusError"]) == OK
    assert logged(silent) == ["logStatusError"]
    assert silent.log(True, ["logStatusDiscard"]) == OK
    assert logged(silent) == both
    assert (loud.log(False, ["logStatusError"]), logged(loud)) == (OK, ["logStatusDiscard"])
    assert (loud.log(False), logged(loud)) == (OK, [])
    assert (loud.log(True), logged(loud)) == (OK, both)
    for wrong in (["logAll"], ["logStatusError", "nonsense"], [None]):
        assert loud.log(False, wrong) == ERROR
        assert "expected the log category logStatusDiscard or logStatusError, got" in loud.told
        assert logged(loud) == both
    for instance in (silent, loud):
        assert instance.call("Reset") == OK
        instance.begin()
    assert (logged(silent), logged(loud)) == ([], both)
    silent.free()
    loud.free()


def test_the_status_of_the_last_step_can_be_asked(made: Made) -> None:
    instance = Library(made("twin", "2.0")).instantiate().begin(2.0)
    time, ended, text = c_double(), c_int(1), c_char_p()
    assert instance.step(2.0, 0.5) == OK
    assert instance.step(3.0, 0.5) == ERROR
    assert (instance.call("GetRealStatus", c_int(2), byref(time)), time.value) == (OK, 2.5)
    assert (instance.call("GetBooleanStatus", c_int(3), byref(ended)), ended.value) == (OK, 0)
    assert instance.call("GetStringStatus", c_int(1), byref(text)) == DISCARD
    instance.free()


def test_event_mode_is_for_those_who_asked_for_it(made: Made) -> None:
    library = Library(made("twin", "3.0"))
    without, with_events = library.instantiate().begin(), library.instantiate(events=True).begin()
    assert without.call("EnterEventMode") == ERROR
    assert "expected an instance that was made with eventModeUsed" in without.told
    assert without.step(0.0) == OK
    status, state = without.unpack(with_events.packed())
    assert (status, without.load(state)) == (OK, ERROR)
    assert "the state is in event mode, which this instance has not" in without.told
    assert without.step(0.01) == OK
    without.free()
    with_events.free()

"""Serialised states are read whole, or refused: damaged ones, those of other models, and forged ones."""

from __future__ import annotations

import struct
from ctypes import byref, c_size_t, c_void_p

import pytest

from dtwin.fmu.sources import Subject, Version
from tests.fmu.conftest import Made
from tests.support.fmi import ERROR, OK, Instance, Library
from tests.support.iec61499.c_harness import needs_compiler

VERSIONS: tuple[Version, ...] = ("3.0", "2.0")
SUBJECTS: tuple[Subject, ...] = ("twin", "controller", "cell")
pytestmark = [
    needs_compiler,
    pytest.mark.parametrize("version", VERSIONS),
    pytest.mark.parametrize("subject", SUBJECTS),
]


@pytest.fixture
def library(made: Made, subject: Subject, version: Version) -> Library:
    return Library(made(subject, version))


@pytest.fixture
def instance(library: Library) -> Instance:
    made = library.instantiate().begin()
    for tick in range(5):
        assert made.step(tick * 0.01) == OK
    return made


def checksum(content: bytes) -> int:
    """FNV-1a with 64 bits."""
    total = 14695981039346656037
    for byte in content:
        total = (total ^ byte) * 1099511628211 % 2**64
    return total


def assert_unread(instance: Instance, packed: bytes, reason: str) -> None:
    status, state = instance.unpack(packed)
    assert (status, state.value) == (ERROR, None)
    assert reason in instance.told


def test_no_damaged_byte_is_missed(instance: Instance, subject: Subject) -> None:
    assert_no_damage_is_missed(instance, 1 if subject == "twin" else 17)


@pytest.mark.thorough
def test_no_damaged_byte_at_all_is_missed(instance: Instance) -> None:
    assert_no_damage_is_missed(instance, 1)


def assert_no_damage_is_missed(instance: Instance, every: int) -> None:
    instance.log(False)
    good = instance.packed()
    for place in range(0, len(good), every):
        damaged = bytearray(good)
        damaged[place] ^= 1 << place % 8
        status, state = instance.unpack(bytes(damaged))
        assert (status, state.value) == (ERROR, None), place
    assert instance.packed() == good
    assert instance.step(0.05) == OK
    instance.free()


def test_a_state_has_one_size(instance: Instance) -> None:
    good = instance.packed()
    for size in (0, 1, 7, 40, 55, len(good) // 2, len(good) - 1):
        assert_unread(instance, good[:size], f"expected a state of {len(good)} bytes, got {size}")
    assert_unread(instance, good + b"\0", f"got {len(good) + 1}")
    assert_unread(instance, bytes(len(good)), "expected a state of the model {")
    room, state = (c_void_p * 1)(), instance.state()
    assert instance.call("SerializeFMUState", state, room, c_size_t(8)) == ERROR
    assert f"expected room for {len(good)} bytes, got 8" in instance.told
    assert instance.packed() == good
    instance.free()


def test_a_state_of_another_model_is_refused(
    made: Made, instance: Instance, subject: Subject, version: Version
) -> None:
    for other in SUBJECTS:
        for number in VERSIONS:
            foreign = Library(made(other, number)).instantiate()
            same = (other, number) == (subject, version)
            status, state = instance.unpack(foreign.packed())
            assert (status == OK) == same
            assert (state.value is not None) == same
            foreign.free()
    instance.free()


def test_a_forged_state_is_looked_at_value_by_value(instance: Instance, library: Library, subject: Subject) -> None:
    """Its checksum fits, so that what is left is what it holds: a text without end, a number out of range, a mode."""
    good = instance.packed()
    assert checksum(good[:-8]) == struct.unpack("<Q", good[-8:])[0]

    def forged(place: int, content: bytes) -> bytes:
        changed = good[:place] + content + good[place + len(content) : -8]
        return changed + struct.pack("<Q", checksum(changed))

    after_head = 56
    places = {after_head: struct.pack("<i", 77), after_head + 32: struct.pack("<q", -1)}
    if subject == "cell":
        places |= {
            good.rindex(b"red\0" + bytes(251)): b"r" * 255,
            good.index(struct.pack("<H", 3) + b"red"): struct.pack("<H", 60000),
            good.index(struct.pack("<d", 0.2)): struct.pack("<d", float("nan")),
        }
    if subject == "twin":
        places |= {good.index(struct.pack("<d", 0.11804)): struct.pack("<d", -1.0)}
    for place, content in places.items():
        assert_unread(instance, forged(place, content), "the state is damaged: it holds values that no instance has")
    assert instance.unpack(forged(0, good[:4]))[0] == OK
    assert instance.packed() == good
    instance.free()


def test_states_are_of_the_instance_that_took_them(library: Library, instance: Instance) -> None:
    """Another's state, a freed one and an address that is none are refused; a serialised one is anybody's."""
    other, state = library.instantiate(), instance.state()
    packed, size = instance.packed(state), c_size_t()
    for stranger in (state, c_void_p(), c_void_p(1)):
        assert other.load(stranger) == ERROR
        assert "expected a state that this instance took or read and that is not freed" in other.told
        assert other.call("SerializedFMUStateSize", stranger, byref(size)) == ERROR
    assert other.call("GetFMUState", byref(c_void_p(state.value))) == ERROR
    assert other.call("FreeFMUState", byref(c_void_p(state.value))) == ERROR
    status, read = other.unpack(packed)
    assert (status, other.load(read)) == (OK, OK)
    assert other.packed() == instance.packed()
    copy = c_void_p(state.value)
    assert (instance.call("FreeFMUState", byref(state)), state.value) == (OK, None)
    assert instance.call("FreeFMUState", byref(state)) == OK
    assert instance.call("FreeFMUState", byref(copy)) == ERROR
    assert instance.load(copy) == ERROR
    other.free()
    instance.free()


def test_a_state_is_taken_into_the_room_of_an_older_one(instance: Instance) -> None:
    state = instance.state()
    before, address = instance.packed(state), state.value
    assert instance.step(0.05) == OK
    assert instance.call("GetFMUState", byref(state)) == OK
    assert state.value == address
    assert instance.packed(state) == instance.packed() != before
    instance.free()


def test_reset_makes_a_new_instance(library: Library, instance: Instance) -> None:
    new = library.instantiate()
    name = next(
        entry.name
        for entry in library.variables.values()
        if entry.kind == "Float64" and entry.causality == "parameter" and entry.variability == "tunable"
    )
    assert instance.set(**{name.replace(".", "__"): library.variables[name].high}) == OK
    assert instance.log(False) == OK
    assert instance.call("Reset") == OK
    assert instance.packed() == new.packed()
    assert instance.step(0.0) == ERROR
    assert "cannot be called before the initialization" in instance.told
    for each in (new, instance):
        each.begin(2.0)
        for tick in range(20):
            assert each.step(2.0 + tick * 0.01) == OK
    assert instance.packed() == new.packed()
    new.free()
    instance.free()

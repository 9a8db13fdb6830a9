"""Calls an FMU in random sequences, and tells where it does what it should not; run as a program of its own.

`python -m tests.support.fmi_fuzz FOLDER BINARY SEED COUNT`: the binary may be one with sanitizers. Every call has
its status from the standard's tables. What is refused changes no byte of the state; no value is ever not finite.
"""

from __future__ import annotations

import math
import random
import sys
from ctypes import byref, c_double, c_size_t, c_uint32, c_void_p
from pathlib import Path

from tests.support.fmi import DISCARD, ERROR, OK, PERIOD, Entry, Library
from tests.support.fmi_modes import allowed, arguments

CALLS = 25
"""Calls in a sequence."""
NUMBERS = (math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, 1e300, -1e300, 1e-12, 0.01, 100.0, -5.0)
_NEXT = {
    "EnterInitializationMode": "initialization",
    "Terminate": "terminated",
    "Reset": "instantiated",
    "EnterEventMode": "event",
    "EnterStepMode": "step",
}


class Sequence:
    """One instance and the state in which the standard has it."""

    def __init__(self, library: Library, chance: random.Random) -> None:
        self.library, self.chance = library, chance
        self.table = allowed(library.version)
        self.events = not library.is_second and chance.random() < 0.5
        self.instance = library.instantiate(logging=chance.random() < 0.5, events=self.events)
        self.state, self.steps, self.is_set_up = "instantiated", 0, False
        self.done: list[str] = []

    def run(self) -> None:
        """A likely begin, so that most of it is not in vain, and then anything."""
        if self.chance.random() < 0.8:
            for function in ("SetupExperiment", "EnterInitializationMode", "ExitInitializationMode", "EnterStepMode"):
                if function in self.table and (function != "EnterStepMode" or self.events):
                    self.call(function)
        for _ in range(CALLS):
            kind = self.chance.random()
            if kind < 0.35:
                self.step()
            elif kind < 0.6:
                self.set()
            elif kind < 0.65:
                self.read_damaged()
            elif kind < 0.75:
                self.move()
            else:
                self.call(self.chance.choice(sorted(self.table)))
        self.instance.free()

    def call(self, function: str) -> None:
        """A function with right arguments, whose status the table tells."""
        if function in ("DoStep", "GetDirectionalDerivative"):
            return  # these have more than their state to be right by
        expected = self.table[function][self.state]
        if function == "EnterInitializationMode" and self.library.is_second and not self.is_set_up:
            expected = ERROR
        if function == "EnterEventMode" and not self.events:
            expected = ERROR
        if function == "ExitInitializationMode" and self.state == "initialization" and self.has_swapped_stops():
            expected = ERROR
        given = arguments(self.instance, function)
        before = self.instance.packed()
        status = getattr(self.library.functions, f"fmi{self.library.version[0]}{function}")(
            self.instance.handle, *given
        )
        self.done.append(f"{function} in {self.state}: {status}")
        self.check(status == expected, f"expected {expected}")
        self.check(status == OK or self.instance.packed() == before, "changed")
        if status == OK:
            self.follow(function)

    def follow(self, function: str) -> None:
        self.is_set_up = (self.is_set_up or function == "SetupExperiment") and function != "Reset"
        if function in ("EnterInitializationMode", "Reset"):
            self.steps = 0
        if function == "ExitInitializationMode":
            self.state = "event" if self.events else "step"
        self.state = _NEXT.get(function, self.state)

    def step(self) -> None:
        """A step that is right, or one with a number that is not."""
        time, duration = self.steps * PERIOD, PERIOD
        is_right = self.chance.random() < 0.6
        if not is_right:
            wrong = self.chance.choice([*NUMBERS, self.chance.uniform(-1e9, 1e9)])
            time, duration = self.chance.choice([(wrong, duration), (time, wrong)])
            is_right = math.isclose(time, self.steps * PERIOD, abs_tol=1e-9) and duration == PERIOD
            if not is_right and abs(time - self.steps * PERIOD) < 1e-3 and 0.0 < duration <= 3600.0:
                return
        is_right = is_right and not (self.state == "step" and self.has_swapped_stops())
        before = self.instance.packed()
        status = self.instance.step(time, duration)
        self.done.append(f"DoStep({time}, {duration}) in {self.state}: {status}")
        has_failed = is_right and self.state == "step" and status == ERROR and self.has_arm
        self.check(has_failed or status == (OK if is_right and self.state == "step" else ERROR), "step")
        self.steps += status == OK
        if has_failed:  # by parameters that are in range, but of no arm that the integration can follow
            self.state = "error" if self.library.is_second else "terminated"
        elif status != OK:
            self.check(self.instance.packed() == before, "changed")
        self.values()

    @property
    def has_arm(self) -> bool:
        return "alpha1" in self.library.variables

    def has_swapped_stops(self) -> bool:
        """Whether the gripper's stops do not fit together, which is seen when they count."""
        names = [name for name in self.library.variables if name.endswith(("gripper_closed_at", "gripper_open_at"))]
        closed, opened = self.instance.get(*names) if names else (0.0, 1.0)
        return bool(closed > opened)

    def set(self) -> None:
        """Some variables of a kind, each to its start, to an end of its range, or to anything."""
        kind = self.chance.choice(("Float64", "Float64", "Float64", "Int32", "String"))
        entries = [e for e in self.library.variables.values() if e.kind == kind and e.is_set_before_the_start]
        if not entries:
            return
        chosen = [self.chance.choice(entries) for _ in range(self.chance.randint(1, 4))]
        values = [self.value(entry) for entry in chosen]
        before = self.instance.packed()
        status = self.instance.put(kind, [entry.reference for entry in chosen], values)
        self.done.append(f"Set{kind}({[entry.name for entry in chosen]}, {values}) in {self.state}: {status}")
        function = {"Float64": "SetReal", "Int32": "SetInteger"}.get(kind, f"Set{kind}")
        may = self.table[function if self.library.is_second else f"Set{kind}"][self.state] == OK
        late = self.state not in ("instantiated", "initialization")
        expected = OK if may else ERROR
        for entry, value in zip(chosen, values, strict=True):
            if expected == OK and late and entry.variability == "fixed":
                expected = ERROR
            elif expected == OK and not is_in_range(entry, value):
                expected = DISCARD
        self.check(status == expected, f"expected {expected}")
        self.check(status == OK or self.instance.packed() == before, "changed")

    def value(self, entry: Entry) -> float | int | str:
        if entry.kind == "String":
            return self.chance.choice(("red", "", "ü" * 127, "x" * 255, "x" * 1000, "no colour"))
        assert entry.low is not None
        assert entry.high is not None
        assert entry.start is not None
        inside = [entry.low, entry.high, float(entry.start), self.chance.uniform(entry.low, entry.high)]
        if entry.kind == "Int32":
            return self.chance.choice([*(int(value) for value in inside), -1, 3, -(2**31), 2**31 - 1])
        return self.chance.choice([*inside, *inside, *NUMBERS])

    def read_damaged(self) -> None:
        """Bytes of a state of which one is another, or of which some are missing."""
        good = self.instance.packed()
        damaged = bytearray(good)
        damaged[self.chance.randrange(len(good))] ^= self.chance.randint(1, 255)
        for packed in (bytes(damaged), good[: self.chance.randrange(len(good))]):
            status, state = self.instance.unpack(packed)
            self.check((status, state.value) == (ERROR, None), "read a damaged state")
        self.check(self.instance.packed() == good, "changed")

    def move(self) -> None:
        """Takes a state, does a step, and goes back; then the state is read by another instance."""
        state = self.instance.state()
        before, known, steps = self.instance.packed(state), self.state, self.steps
        self.step()
        self.check(self.instance.load(state) == OK, "load")
        self.state, self.steps = known, steps
        self.check(self.instance.packed() == before, "another state")
        self.check(self.instance.call("FreeFMUState", byref(state)) == OK, "free")
        other = self.library.instantiate(events=self.events)
        status, read = other.unpack(before)
        self.check((status, other.load(read), other.packed()) == (OK, OK, before), "another instance")
        self.check(other.call("FreeFMUState", byref(c_void_p(1))) == ERROR, "a state that is none")
        other.free()

    def values(self) -> None:
        """All real variables are finite, wherever they can be got."""
        if self.library.is_second and self.state == "instantiated":
            return
        names = [entry.name for entry in self.library.variables.values() if entry.kind == "Float64"]
        self.check(all(map(math.isfinite, self.instance.get(*names))), "a value is not finite")
        if "alpha1" in names and self.state == "step" and "box_mass" not in names:
            variables, one = self.library.variables, c_size_t(1)
            unknown, known = ((c_uint32 * 1)(variables[name].reference) for name in ("alpha1", "V1"))
            count = () if self.library.is_second else (one,)
            call = (unknown, one, known, one, (c_double * 1)(1.0), *count, (c_double * 1)(), *count)
            self.check(self.instance.call("GetDirectionalDerivative", *call) == OK, "derivative")

    def check(self, good: bool, problem: str) -> None:
        if not good:
            raise AssertionError("\n".join([*self.done, problem, *(m.text for m in self.instance.messages[-3:])]))


def is_in_range(entry: Entry, value: float | int | str) -> bool:
    if isinstance(value, str):
        return len(value.encode()) < 255
    return entry.low is not None and entry.high is not None and entry.low <= value <= entry.high


def fuzz(library: Library, seed: int, count: int) -> None:
    """Runs sequences of calls.

    Raises:
        AssertionError: one did what it should not; the message has its calls.
    """
    for number in range(count):
        Sequence(library, random.Random(f"{seed} {number}")).run()


if __name__ == "__main__":
    folder, binary = Path(sys.argv[1]), Path(sys.argv[2])
    fuzz(Library(folder, binary), int(sys.argv[3]), int(sys.argv[4]))
    print(f"{sys.argv[4]} sequences")

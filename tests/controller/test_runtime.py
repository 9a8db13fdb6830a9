"""The blocks of the cell as machine code and in Python: one and the same, to the bit."""

from __future__ import annotations

from typing import Any

import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.motion import MotionController
from dtwin.controller.ports import LOAD, MODEL, OFFSETS, REQUEST, TUNING, VERDICT
from dtwin.controller.runtime import VARIABLE, Runtime, chosen
from dtwin.controller.settings import APPLICATION_LAW, ControlSettings, usual_gains
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.emulation.faults import parse_fault
from dtwin.errors import CommunicationError, DtwinError, FunctionBlockError, ParameterError
from dtwin.parameters import PERIOD, PICKUP, ArmParameters, Gains
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from iec61499.native import build
from iec61499.native.resource import NativeResource
from iec61499.runtime.resource import Resource
from tests.support.iec61499.c_harness import needs_compiler

FAULTS = ("K2*=0.6@4-7", "bias1+=0.02@9", "freeze3@11-11.3")
SETTINGS = CellSettings(
    seed=5,
    noise=0.002,
    faults=tuple(map(parse_fault, FAULTS)),
    control=ControlSettings(1.0, usual_gains(APPLICATION_LAW), APPLICATION_LAW),
)


def disturbed(runtime: Runtime, duration: float) -> tuple[dict[str, Any], dict[str, dict[str, Any]], list[str]]:
    """A run with noise, faults, uploads, an identification signal and stops: log, variables of all blocks, events."""
    with chosen(runtime):
        controller = EmbeddedController(SETTINGS.control)
    assert isinstance(controller.resource, NativeResource if runtime == "native" else Resource)
    port, verdicts = EmbeddedPort(controller), controller.resource.server(VERDICT.block)
    settings = CellSettings(duration=duration, seed=5, noise=0.002, faults=SETTINGS.faults, control=SETTINGS.control)
    cell = Cell(settings, controller)
    plan = {
        2: lambda: port.put(TUNING, ControlSettings(1.5, Gains((500.0,) * 3, (2000.0,) * 3, (40.0,) * 3))),
        3: lambda: port.put(MODEL, ControlSettings(model=ArmParameters().with_values({"m1": 0.13}))),
        5: lambda: port.put(LOAD, ControlSettings(payload=0.21)),
        6: lambda: verdicts.exchange((2, 0.999, False)),
        8: lambda: verdicts.exchange((0, 1.0, True)),
        9: lambda: port.put(OFFSETS, ControlSettings(encoder_offset=(0.01, 0.0, -0.01))),
        10: lambda: controller.resource.port(REQUEST.block).deliver((True,)),
    }

    def between(done: int) -> bool:
        second = round(done * PERIOD)
        if second % 60 in plan:
            plan[second % 60]()
        return True

    cell.run(between)
    log = cell.log.freeze()
    return dict(log.columns), controller.resource.states(), [repr(event) for event in log.events]


@needs_compiler
def test_a_disturbed_run_is_the_same_to_the_bit() -> None:
    native, python = disturbed("native", 14.0), disturbed("python", 14.0)
    assert {name: column.tobytes() for name, column in native[0].items()} == {
        name: column.tobytes() for name, column in python[0].items()
    }
    assert repr(native[1]) == repr(python[1])
    assert native[2] == python[2]


@needs_compiler
def test_a_server_that_receives_nothing_answers_nothing() -> None:
    with chosen("native"):
        resource = EmbeddedController().resource
    with pytest.raises(CommunicationError, match="answered 0 times"):
        resource.server("TWIN.MONITORING.DATA").exchange(())


@needs_compiler
def test_a_snapshot_brings_a_motion_back() -> None:
    with chosen("native"):
        controller = MotionController()
    blocks = controller.resource
    first = controller.start(PICKUP.theta, "red", ControlSettings())
    before = blocks.snapshot()
    then = [controller.step(PICKUP.theta) for _ in range(5)]
    blocks.restore(before)
    assert [controller.step(PICKUP.theta) for _ in range(5)] == then
    assert controller.start(PICKUP.theta, "red", ControlSettings()) == first


@needs_compiler
def test_variables_are_checked_as_in_python() -> None:
    messages = []
    runtimes: tuple[Runtime, ...] = ("native", "python")
    for runtime in runtimes:
        with chosen(runtime):
            blocks = MotionController().resource
        for name, value in (("PLANNER.T", "soon"), ("CONTROLLER.LAW", 1 << 40), ("PLANNER.$ECC", 1)):
            with pytest.raises(FunctionBlockError) as caught:
                blocks.write(name, value)
            messages.append(str(caught.value))
        for name in ("PLANNER.NOTHING", "NOBODY.T"):
            with pytest.raises(FunctionBlockError):
                blocks.read(name)
        assert blocks.read("PLANNER.$ECC") == "INITIALISED"
    assert messages[:3] == messages[3:]


def test_an_unknown_runtime_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "fortran")
    with pytest.raises(ParameterError, match="native or python"):
        MotionController()


def test_without_a_compiler_the_blocks_run_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("iec61499.native.build.compilers", lambda: iter(()))
    monkeypatch.setattr(build, "_machine_code", build._machine_code.__wrapped__)  # nothing was made in this process
    monkeypatch.delenv(VARIABLE, raising=False)
    assert isinstance(MotionController().resource, Resource)
    with chosen("native"), pytest.raises(DtwinError, match="ziglang"):
        MotionController()

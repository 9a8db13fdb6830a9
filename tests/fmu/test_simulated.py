"""FMPy accepts the FMUs and simulates what dtwin computes itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.fmu.sources import Subject, Version
from dtwin.parameters import HANGING, PERIOD, ArmParameters, GripperParameters
from dtwin.twin.dynamics import forward_dynamics
from dtwin.twin.rollout import rollout
from tests.fmu.conftest import Made
from tests.support.closed_loop import closed_loop
from tests.support.iec61499.c_harness import needs_compiler

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install dtwin[test]")
pytestmark = needs_compiler

VERSIONS: tuple[Version, ...] = ("3.0", "2.0")
SUBJECTS: tuple[Subject, ...] = ("twin", "controller", "cell")
SETTERS = {"Float64": ("setFloat64", "setReal"), "Boolean": ("setBoolean",) * 2, "String": ("setString",) * 2}
GETTERS = {"Float64": ("getFloat64", "getReal"), "Boolean": ("getBoolean",) * 2}
JOINTS = (1, 2, 3)
STATES = (*(f"theta{j}" for j in JOINTS), *(f"omega{j}" for j in JOINTS))


class Slave:
    """An FMU in FMPy's hands, its variables by name."""

    def __init__(self, folder: Path, **start: Any) -> None:
        from fmpy.simulation import instantiate_fmu

        description = fmpy.read_model_description(str(folder))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self._second = description.fmiVersion == "2.0"
        self.fmu = instantiate_fmu(str(folder), description, fmi_type="CoSimulation")
        if self._second:
            self.fmu.setupExperiment(startTime=0.0)
        self.set(**start)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, **values: Any) -> None:
        for name, value in values.items():
            kind = {bool: "Boolean", str: "String"}.get(type(value), "Float64")
            setter = getattr(self.fmu, SETTERS[kind][self._second])
            setter([self.references[name.replace("__", ".")]], [value])

    def get(self, *names: str, kind: str = "Float64") -> list[Any]:
        values: list[Any] = getattr(self.fmu, GETTERS[kind][self._second])([self.references[n] for n in names])
        return values

    def step(self, tick: int, duration: float = PERIOD) -> None:
        self.fmu.doStep(currentCommunicationPoint=tick * PERIOD, communicationStepSize=duration)

    def call(self, name: str, *arguments: Any) -> Any:
        """Calls a function of FMI 3.0, or what it was called in FMI 2.0."""
        name = name.replace("deserialize", "deSerialize").replace("State", "state") if self._second else name
        return getattr(self.fmu, name)(*arguments)

    def directional(self, unknowns: list[str], known: str) -> list[float]:
        references = [self.references[name] for name in unknowns]
        values: list[float] = self.fmu.getDirectionalDerivative(references, [self.references[known]], [1.0])
        return values


@pytest.fixture
def slave(made: Made) -> Iterator[Callable[..., Slave]]:
    opened: list[Slave] = []

    def instantiate(subject: Subject, version: Version, **start: Any) -> Slave:
        opened.append(Slave(made(subject, version), **start))
        return opened[-1]

    yield instantiate
    for each in opened:
        each.fmu.terminate()
        each.fmu.freeInstance()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("subject", SUBJECTS)
def test_the_description_is_valid(made: Made, subject: Subject, version: Version) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(made(subject, version))) == []


@pytest.mark.parametrize("version", VERSIONS)
def test_the_twin_is_the_rollout(made: Made, version: Version) -> None:
    ticks = 500
    times = np.arange(ticks + 1) * PERIOD
    names = ("V1", "V2", "V3", "V_gripper", "payload")
    signals = np.zeros(ticks + 1, dtype=[("time", float), *((name, float) for name in names)])
    signals["time"] = times
    for joint in JOINTS:
        signals[f"V{joint}"] = (joint + 3.0) * np.sin(joint * times)
    signals["payload"] = np.where(times > 2.0, 0.2, 0.0)
    found = fmpy.simulate_fmu(
        str(made("twin", version)),
        stop_time=ticks * PERIOD,
        step_size=PERIOD,
        output_interval=PERIOD,
        input=signals,
        start_values={"mu2": 0.01, "omega1_start": 0.5},
    )
    arm = ArmParameters().with_values({"mu2": 0.01})
    volts = np.stack([signals[f"V{joint}"] for joint in JOINTS], axis=1)[:-1]
    expected = rollout(arm, (*HANGING, 0.5, 0.0, 0.0), volts, signals["payload"][:-1])
    states = np.stack([found[name] for name in STATES], axis=1)
    assert np.abs(states - expected).max() <= 1e-12


@pytest.mark.parametrize("version", VERSIONS)
def test_the_controller_answers_as_the_embedded_one(slave: Callable[..., Slave], version: Version) -> None:
    settings = ControlSettings(target_time=1.5)
    embedded, plant = EmbeddedController(settings), Emulation(seed=28)
    fmu = slave("controller", version, PLANNER__T=1.5)
    seen = set()
    for tick in range(400):
        sample = plant.read()
        command = embedded.step(sample)
        fmu.set(**{f"theta{j}": sample.theta[j - 1] for j in JOINTS}, gripper=sample.gripper)
        fmu.set(box_present=sample.box_present, box_colour=sample.box_colour)
        fmu.step(tick)
        assert tuple(fmu.get("V1", "V2", "V3", "V_gripper")) == command.volts
        assert fmu.get("box_gripped", kind="Boolean") == [command.box_gripped]
        seen.add(command.box_gripped)
        plant.apply(command)
        plant.advance(PERIOD)
    assert seen == {True, False}


@pytest.mark.parametrize("version", VERSIONS)
def test_the_cell_is_controller_and_rollout(slave: Callable[..., Slave], version: Version) -> None:
    """A red box is picked and brought to its place; the gripper moves freely until it meets a stop."""
    fmu = slave("cell", version, box_mass=0.195)
    carried = 0
    for tick, expected in enumerate(closed_loop(600, "red", 0.195)):
        fmu.step(tick)
        assert np.abs(np.array(fmu.get(*STATES)) - expected.state).max() <= 1e-12
        assert abs(fmu.get("gripper")[0] - expected.gripper) <= 1e-12
        assert fmu.get("payload") == [expected.payload]
        carried += expected.payload > 0.0
    assert 100 < carried < 400


@pytest.mark.parametrize("version", VERSIONS)
def test_steps_need_not_be_ticks(slave: Callable[..., Slave], version: Version) -> None:
    """The controller keeps its own clock: steps of 3 ms, in which ticks begin anywhere, are the same motion."""
    by_tick, finer = (slave("cell", version, arm__longest_step=0.0005) for _ in range(2))
    for tick in range(60):
        by_tick.step(tick)
    for step in range(200):
        finer.fmu.doStep(currentCommunicationPoint=step * 0.003, communicationStepSize=0.003)
    assert np.abs(np.array(by_tick.get(*STATES)) - finer.get(*STATES)).max() <= 1e-12
    assert by_tick.get("V1", "V2", "V3") == pytest.approx(finer.get("V1", "V2", "V3"), abs=1e-9)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("subject", ["twin", "cell"])
def test_a_state_goes_on_as_it_was(slave: Callable[..., Slave], subject: Subject, version: Version) -> None:
    first, second = slave(subject, version), slave(subject, version)
    for tick in range(100):
        first.step(tick)
    state = first.call("getFMUState")
    packed = first.call("serializeFMUState", state)
    for tick in range(100, 200):
        first.step(tick)
    expected = first.get(*STATES)
    first.call("setFMUState", state)
    for tick in range(100, 200):
        first.step(tick)
    assert first.get(*STATES) == expected
    first.call("freeFMUState", state)
    second.call("setFMUState", second.call("deserializeFMUState", packed))
    for tick in range(100, 200):
        second.step(tick)
    assert second.get(*STATES) == expected
    with pytest.raises(Exception, match="rror"):
        second.call("deserializeFMUState", bytes(len(packed)))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("known", ["V2", "theta1", "omega3", "payload", "K1", "m2", "I3", "l1", "c3", "D2", "mu1"])
def test_directional_derivatives(slave: Callable[..., Slave], version: Version, known: str) -> None:
    """They are the derivatives of the equations of motion, here by central differences."""
    arm = ArmParameters().with_values({"mu1": 0.02})
    fmu = slave("twin", version, mu1=0.02, V2=1.5, payload=0.1, omega1_start=0.3, theta2_start=0.4)
    state = np.array((*HANGING, 0.3, 0.0, 0.0))
    state[1] = 0.4

    def acceleration(change: float) -> np.ndarray:
        x, volts, p, payload = state.copy(), np.array([0.0, 1.5, 0.0]), arm, 0.1
        if known in STATES:
            x[STATES.index(known)] += change
        elif known == "V2":
            volts[1] += change
        elif known == "payload":
            payload += change
        else:
            p = arm.with_values({known: arm.get(known) + change})
        return np.asarray(forward_dynamics(x, volts, np.array(p.vector()), payload))

    step = 1e-6
    expected = (acceleration(step) - acceleration(-step)) / (2.0 * step)
    names = [f"alpha{j}" for j in JOINTS]
    assert fmu.get(*names) == pytest.approx(acceleration(0.0), rel=1e-12)
    assert fmu.directional(names, known) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    others = [name for name in STATES if name != known]
    assert fmu.directional(others, known) == [0.0] * len(others)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("subject", SUBJECTS)
def test_outputs_follow_at_once_only_what_they_are_said_to(
    made: Made, slave: Callable[..., Slave], subject: Subject, version: Version
) -> None:
    """Another value of an input moves, before the next step, the outputs alone that name it."""
    description = fmpy.read_model_description(str(made(subject, version)))
    real = {v.name for v in description.modelVariables if v.type in ("Real", "Float64")}
    outputs = {u.variable.name: {v.name for v in u.dependencies} for u in description.outputs}
    outputs = {name: knowns for name, knowns in outputs.items() if name in real}
    fmu = slave(subject, version)
    for tick in range(10):
        fmu.step(tick)
    for known in (v.name for v in description.modelVariables if v.causality == "input" and v.name in real):
        before = fmu.get(*outputs)
        (value,) = fmu.get(known)
        fmu.set(**{known: value + 0.1})
        moved = {name for name, old, new in zip(outputs, before, fmu.get(*outputs), strict=True) if old != new}
        assert moved <= {name for name, knowns in outputs.items() if known in knowns}
        assert moved or subject != "twin" or known == "V_gripper"


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("subject", SUBJECTS)
def test_outputs_start_from_what_they_are_said_to(
    made: Made, slave: Callable[..., Slave], subject: Subject, version: Version
) -> None:
    description = fmpy.read_model_description(str(made(subject, version)))
    real = [v for v in description.modelVariables if v.type in ("Real", "Float64")]
    names = {v.name for v in real}
    unknowns = {u.variable.name: u.dependencies for u in description.initialUnknowns if u.variable.name in names}
    usual = slave(subject, version).get(*unknowns)
    for known in (v for v in real if v.causality in ("input", "parameter")):
        start = float(known.start)
        value = start + 0.01 if start + 0.01 <= float(known.max) else start - 0.01
        other = slave(subject, version, **{known.name.replace(".", "__"): value}).get(*unknowns)
        moved = [name for name, old, new in zip(unknowns, usual, other, strict=True) if old != new]
        for name in moved:
            knowns = unknowns[name]
            assert knowns is None or known.name in {v.name for v in knowns}


def test_the_gripper_makes_events(made: Made) -> None:
    """FMI 3.0 alone has events in co-simulation: here the gripper leaves its open stop and meets the closed one."""
    from fmpy.fmi3 import FMU3Slave

    folder = made("twin", "3.0")
    description = fmpy.read_model_description(str(folder))
    references = {v.name: v.valueReference for v in description.modelVariables}
    fmu = FMU3Slave(
        guid=description.guid,
        unzipDirectory=str(folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="gripper",
    )
    fmu.instantiate(eventModeUsed=True)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    with pytest.raises(Exception, match="rror"):
        fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=PERIOD)
    fmu.enterStepMode()
    fmu.setFloat64([references["V_gripper"]], [-GripperParameters().volts])
    stops, changes = [references["gripper_is_open"], references["gripper_is_closed"]], []
    before = fmu.getBoolean(stops)
    for tick in range(100):
        event, *_ = fmu.doStep(currentCommunicationPoint=tick * PERIOD, communicationStepSize=PERIOD)
        now = fmu.getBoolean(stops)
        assert event == (now != before)
        if event:
            changes.append(now)
            fmu.enterEventMode()
            assert not any(fmu.updateDiscreteStates()[:5])
            fmu.enterStepMode()
        before = now
    assert changes == [[False, False], [False, True]]
    fmu.terminate()
    fmu.freeInstance()


@pytest.mark.parametrize("version", VERSIONS)
def test_start_values_are_set_before_the_start(slave: Callable[..., Slave], version: Version) -> None:
    fmu = slave("twin", version, theta1_start=0.25)
    assert fmu.get("theta1") == [0.25]
    with pytest.raises(Exception, match="rror"):
        fmu.set(theta1_start=0.5)
    with pytest.raises(Exception, match="rror"):
        fmu.set(theta1=0.5)

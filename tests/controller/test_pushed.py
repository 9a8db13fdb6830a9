"""An arm that was pushed off its path: the blocks stop it, and it stands."""

import numpy as np
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOP
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.parameters import ArmParameters
from dtwin.run.loop import run, tick_count
from dtwin.signals import STOPS, StepRecord
from dtwin.simulation.proposal import with_rotors
from evidence.recovery.expected import made_of
from evidence.recovery.frozen import known_drives

MACHINE = "881002"
"""A drawn machine with rotors, friction and coarse encoders, whose controller knows all of that."""
REST = 3.5
"""Plant time by which the arm has stood still for long, s."""


@pytest.mark.parametrize("push", ["push2+=0.57@2-2.25", "push3+=0.71@2-2.25"])
def test_an_arm_that_was_pushed_off_its_path_comes_to_rest(push: str) -> None:
    """It comes back to its path, and is past it when the braking ends. It shook with its voltages at their limits, as
    no acceleration was expected of these any more, or fell, as it passed its place just when that was looked at."""
    machine = machine_of(MACHINE)
    arm, effects = made_of(machine, ArmParameters())
    compensation = known_drives(machine.sensing, arm, effects)
    controller = EmbeddedController(
        ControlSettings(law="cascade", model=with_rotors(arm, effects), compensation=compensation)
    )
    stop_now = controller.resource.reader((STOP,))
    seen: list[tuple[float, str, float, float]] = []

    def record(step: StepRecord) -> None:
        volts, speed = np.abs(step.voltages.volts[:3]).max(), np.abs(step.truth.omega).max()
        seen.append((step.truth.time, STOPS[int(stop_now()[0])], float(volts), float(speed)))

    run(Emulation(machine=machine, seed=1, faults=(parse_fault(push),)), controller, tick_count(4.5), record=record)
    assert {stop for time, stop, _, _ in seen if time > REST} == {"standstill"}
    assert max(volts for time, _, volts, _ in seen if time > REST) < 8.0
    assert max(speed for time, _, _, speed in seen if time > REST) < 0.2

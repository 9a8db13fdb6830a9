"""What a service does before it is ready leaves no kernel to be compiled or loaded later."""

import subprocess
import sys

import pytest

from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.readiness.rehearsal import Rehearsal
from dtwin.monitoring.settings import MonitorSettings
from dtwin.parameters import ROOT, ArmParameters

WATCHED = """
import numpy as np
from dtwin.monitoring.estimation.belief import assumed, commissioned
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.readiness.rehearsal import Rehearsal
from dtwin.monitoring.settings import MonitorSettings
from dtwin.parameters import ArmParameters
from tests.support.kernels import loaded, never_called
from tests.support.records import recorded

for belief in (assumed(ArmParameters(), (0.0, 0.0, 0.0)), commissioned(recorded())):
    for _, act in Rehearsal(belief, MonitorSettings()).parts():
        act()
assert not never_called("dtwin.monitoring"), never_called("dtwin.monitoring")
"""
"""Rehearses both kinds of motion that a monitor may believe in."""

UPLOADED = """
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import ArmParameters, Gains
from dtwin.simulation.checks import Checker
from tests.support.kernels import loaded

checker = Checker()
checker.load()
before = loaded()
arm = ArmParameters().with_values({"K2": 0.3, "mu1": 0.05})
checker.check(ControlSettings(), ArmParameters())
checker.expect(ControlSettings(), arm, 0.05, late=1.0)
checker.keeps_margins(ControlSettings(), arm, late=0.5)
assert loaded() == before, loaded() - before
"""
"""Checks settings as the first upload does."""

IDENTIFIED = """
from dtwin.identification.estimation.estimate import EstimationSettings
from dtwin.identification.parsing import settings_for
from dtwin.identification.rehearsal import rehearse
from dtwin.identification.running import estimate_excited, estimate_from, renewed
from dtwin.parameters import ArmParameters
from tests.support.identification import clean
from tests.support.kernels import loaded

rehearse()
before = loaded()
estimate_excited(clean(), settings_for("D1,mu1,m2"))
known = renewed(ArmParameters(), {"D2": 0.01, "K1": 0.01}, ("D2", "K1"), ("K1",))
estimate_from([clean()] * 4, known, "motions")
assert loaded() == before, loaded() - before
"""
"""Identifies as the first request asks for it, from a signal and from motions."""


@pytest.mark.parametrize("work", [WATCHED, UPLOADED, IDENTIFIED], ids=["monitoring", "simulation", "identification"])
def test_no_kernel_is_left_for_later(work: str) -> None:
    done = subprocess.run([sys.executable, "-c", work], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def test_a_rehearsal_goes_through_suspicion_finding_acknowledgement_and_recovery() -> None:
    rehearsal = Rehearsal(assumed(ArmParameters(), (0.0, 0.0, 0.0)), MonitorSettings())
    for _, act in rehearsal.parts():
        act()
    monitor = rehearsal.monitor
    assert {"suspected", "failed", "acknowledged", "recovered"} <= {event.kind for event in monitor.events}
    assert {finding.parameter for finding in monitor.history} >= {"K2", "freeze2", "bias2"}
    assert monitor.missed == 2
    assert isinstance(monitor.verdict(), MonitoringVerdict)

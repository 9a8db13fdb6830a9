"""The design of the cascade's gains and the margins that they have, computed at 50 poses and measured at some."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.controller.settings import USUAL_GAINS, ControlSettings
from dtwin.parameters import PERIOD, ArmParameters, Law
from dtwin.pictures import COLOURS, RED, legend, new_figure
from dtwin.simulation.margins.demands import MARGINS, Case, cases
from dtwin.simulation.margins.design import LATE, NOISE, RESERVE, Candidate, best_of, design
from dtwin.simulation.margins.loop import ComplexArray, linear_loop
from dtwin.simulation.margins.poses import Pose, places, poses
from dtwin.simulation.whatif import Simulator
from evidence.experiment import ExperimentCommand
from evidence.report import Picture, Report, page, table
from evidence.simulation.injected import frequency, measured_sensitivity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CYCLES: Final = (1, 3, 6, 10, 16, 25, 40, 63, 100)
"""Periods in the window of the sines that are injected."""
SAME: Final = 0.02
"""Largest difference of a measured sensitivity from the computed one that counts as none."""
_ARM: Final = ArmParameters()
_LAWS: Final[tuple[Law, ...]] = ("computed_torque", "cascade")


@dataclass(frozen=True, slots=True, eq=False)
class MarginStudy:
    """The result of the study.

    Attributes:
        candidates: candidates that were judged.
        best: gains of the largest integral gain among those with all margins.
        cases: margins of the usual gains at all poses, by law and the ticks after which the arm obeys.
        sensitivities: largest difference of the measured sensitivity from the computed one, and the largest computed
            one, by place and box.
        shapes: return ratios of each motor at the places with a box, by law, (places, frequencies, 3).
    """

    candidates: tuple[Candidate, ...]
    best: Candidate
    cases: dict[tuple[Law, float], list[Case]]
    sensitivities: dict[tuple[str, float], tuple[float, float]]
    shapes: dict[Law, ComplexArray]


def usual(law: Law) -> ControlSettings:
    """The settings of a law with its usual gains."""
    return ControlSettings(gains=USUAL_GAINS[law], law=law)


def margin_study(progress: Progress) -> MarginStudy:
    """Designs, computes and measures."""
    simulator = Simulator()
    candidates = design(simulator.controller, ControlSettings(law="cascade"), _ARM, progress)
    computed = {
        (law, late): cases(simulator.controller, usual(law), _ARM, poses(), late) for law in _LAWS for late in LATE
    }
    compared = {
        (pose.name, payload): compare(simulator, usual("cascade"), pose, payload, CYCLES)
        for pose in places()
        for payload in (0.0, 0.2)
    }
    shapes = {law: np.array([_shape(simulator, usual(law), pose) for pose in places()]) for law in _LAWS}
    return MarginStudy(candidates, best_of([each for each in candidates if each.good]), computed, compared, shapes)


def compare(
    simulator: Simulator, settings: ControlSettings, pose: Pose, payload: float, cycles: Sequence[int]
) -> tuple[float, float]:
    """Largest difference of measured and computed input sensitivity at some frequencies, and the largest computed."""
    z = np.exp(1j * np.array([frequency(each) for each in cycles]) * PERIOD)
    loop = linear_loop(simulator.controller, settings, _ARM, payload, pose.theta)
    expected = np.linalg.inv(np.eye(3) + loop.returned(z))
    found = np.array([measured_sensitivity(simulator, settings, _ARM, payload, pose.theta, each) for each in cycles])
    return float(np.abs(found - expected).max()), float(np.abs(expected).max())


_FREQUENCIES: Final = np.geomspace(0.5, 300.0, 300)


def _shape(simulator: Simulator, settings: ControlSettings, pose: Pose) -> ComplexArray:
    loop = linear_loop(simulator.controller, settings, _ARM, settings.payload, pose.theta)
    sensitivity = np.linalg.inv(np.eye(3) + loop.returned(np.exp(1j * _FREQUENCIES * PERIOD)))
    shape: ComplexArray = 1.0 / np.einsum("kii->ki", sensitivity) - 1.0
    return shape


def kept(study: MarginStudy) -> bool:
    """Whether the usual gains are those of the design and have the margins, and sines measured what was computed."""
    as_designed = USUAL_GAINS["cascade"] == study.best.gains
    enough = all(MARGINS.shortfall(case.margins) is None for case in study.cases["cascade", 0.0])
    return as_designed and enough and max(apart for apart, _ in study.sensitivities.values()) < SAME


def margin_report(study: MarginStudy) -> Report:
    """The page of the study."""
    good = sorted((each for each in study.candidates if each.good), key=lambda each: -each.gains.ki[0])[:8]
    rows = [
        [f"{value:g}" for value in (c.position, c.velocity, c.gains.kp[0], c.gains.ki[0], c.gains.kd[0])]
        + [f"{c.worst:.2f}", f"{c.noise:.0f}"]
        for c in good
    ]
    compared = [
        [name, f"{payload:g} kg", f"{largest:.2f}", f"{apart:.0e}"]
        for (name, payload), (apart, largest) in study.sensitivities.items()
    ]
    return page(
        "Margins of the controller",
        "How much the arm may differ from its model before the loop of function blocks and arm is unstable, "
        f"linearised at {len(poses())} poses with and without a box of 0.2 kg.",
        "## Worst of all poses",
        table(
            ["law", "arm obeys after", "disk", "gain dB", "phase °", "delay ticks", "one motor's torque", "peak S"],
            [[law, f"{late:g} ticks", *worst_row(found)] for (law, late), found in study.cases.items()],
        ),
        Picture(
            _chart(study),
            "Return ratio (above) and sensitivity (below) of each motor over frequency, the other motors in "
            "closed loop, for the arm with a box at the pickup point and the three places; under the thesis's "
            "computed torque and under the cascade.",
        ),
        "## Design of the cascade",
        f"Of {len(study.candidates)} pairs of poles {sum(c.worst >= 1.0 for c in study.candidates)} have a disk "
        f"margin of {RESERVE.disk:g} and all other margins that are demanded, at the places with and without a box, "
        "on an arm that obeys at once and on one that obeys a tick late. White noise of the encoders may make at "
        f"most {NOISE:g} V per rad of any voltage, standard deviations: {sum(c.good for c in study.candidates)} "
        "keep to that too, and the one with the largest integral gain is taken.",
        table(
            ["position rad/s", "velocity rad/s", "kp", "ki", "kd", "least share of a margin", "V of noise per rad"],
            rows,
        ),
        "## Measured",
        f"Sines of {len(CYCLES)} frequencies from {frequency(CYCLES[0]):.1f} to {frequency(CYCLES[-1]):.0f} rad/s "
        "were added to each motor's voltage on the emulation: the largest computed sensitivity, and how far the "
        "measured one was from it at most.",
        table(["place", "box", "sensitivity", "difference"], compared),
    )


def worst_row(found: Sequence[Case]) -> list[str]:
    """The least of each margin over some cases, as the cells of a table."""
    every = [case.margins for case in found]
    return [
        f"{min(m.disk for m in every):.2f}",
        f"{min(m.gain for m in every):.1f}",
        f"{min(min(m.phase) for m in every):.0f}",
        f"{min(m.delay for m in every):.2f}",
        f"{-min(min(m.weaker) for m in every):.0%} to {min(min(m.stronger) for m in every):+.0%}",
        f"{max(max(m.sensitivity) for m in every):.1f}",
    ]


def _chart(study: MarginStudy) -> Figure:
    figure = new_figure(12, 7)
    axes = figure.subplots(2, 3, sharex=True, sharey="row")
    for motor in range(3):
        for law, colour in zip(_LAWS, (RED, COLOURS[0]), strict=True):
            for number, shape in enumerate(study.shapes[law]):
                ratio = shape[:, motor]
                label = law if number == 0 else None
                axes[0, motor].loglog(_FREQUENCIES, np.abs(ratio), color=colour, lw=1.0, label=label)
                axes[1, motor].loglog(_FREQUENCIES, np.abs(1.0 / (1.0 + ratio)), color=colour, lw=1.0)
        axes[0, motor].axhline(1.0, color="black", lw=0.6)
        axes[1, motor].axhline(2.0, color="black", lw=0.6, ls=":")
        axes[0, motor].set_title(f"motor {motor + 1}")
        axes[1, motor].set_xlabel("rad/s")
    axes[0, 0].set_ylabel("|L|, the other motors in closed loop")
    axes[1, 0].set_ylabel("|S| = 1 / |1 + L|")
    axes[0, 0].set_ylim(1e-2, 1e3)
    legend(axes[0, -1])
    return figure


@dataclass(frozen=True)
class ExperimentMargins(ExperimentCommand[MarginStudy]):
    """Design the gains of the cascade law for its margins, compute them at 50 poses, and measure them by sines.

    Nothing in it is random. Fails when the law has other gains than those that the design finds, when a margin is
    below what is demanded, or when a measured sensitivity is not the computed one.
    """

    name: ClassVar = "margins"

    def measure(self, progress: Progress) -> MarginStudy:
        return margin_study(progress)

    def report(self, result: MarginStudy) -> Report:
        return margin_report(result)

    def figures(self, result: MarginStudy) -> dict[str, Any]:
        return {
            "best": msgspec.to_builtins(result.best),
            "candidates": len(result.candidates),
            "largest_difference": max(apart for apart, _ in result.sensitivities.values()),
            "least_disk_margin": {
                f"{law}, {late:g} ticks late": min(case.margins.disk for case in found)
                for (law, late), found in result.cases.items()
            },
        }

    def passed(self, result: MarginStudy) -> bool:
        return kept(result)

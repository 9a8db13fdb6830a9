"""The report of a commissioning: one page in HTML that needs no other file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from dtwin.commissioning.html import bullets, document, heading, paragraph, picture, table
from dtwin.commissioning.procedure import Commissioned, Identified
from dtwin.commissioning.words import GRADES, NINETY_FIVE, interval, load, quantity, steps
from dtwin.controller.proposed import LeastMargins
from dtwin.identification.machine.record import Grade, MachineRecord
from dtwin.monitoring.calibration import compliances
from dtwin.monitoring.estimation.belief import Tail, commissioned
from dtwin.monitoring.kinds import JUMPS
from dtwin.monitoring.settings import ALARMS_PER_HOUR
from dtwin.monitoring.signatures import allowances, threshold
from dtwin.parameters import PERIOD
from dtwin.pictures import COLOURS, DARK, RED, new_figure, vector_graphics
from dtwin.simulation.margins.demands import MARGINS, Demands

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOOKS: Final[dict[Grade, str]] = {"identified": "good", "approximate": "fair", "unusable": "poor"}


def report(found: Commissioned) -> str:
    """The page of an arm that was commissioned."""
    record = found.record
    return document(
        "Commissioning of an arm",
        [
            paragraph(GRADES[record.grade], f"grade {_LOOKS[record.grade]}"),
            paragraph(f"Data: {record.source}, {record.sensors.duration:g} s."),
            *_sensors(record),
            *_numbers(record),
            *_fit(found.identified, record),
            *_settings(record),
            *_monitor(record),
            *_made(record),
        ],
    )


def _sensors(record: MachineRecord) -> list[str]:
    check, delay = record.sensors, record.numbers["delay"]
    rows = [
        [
            f"joint {joint}",
            steps(encoder.step),
            f"{1e3 * encoder.noise:.3f}",
            "never at rest" if encoder.rest is None else f"{1e3 * encoder.rest:.3f}",
            f"{encoder.spikes:.0f}",
            f"{1e3 * encoder.least_spike:.1f}",
        ]
        for joint, encoder in enumerate(check.encoders, 1)
    ]
    lost = (
        "The arm never moved fast enough to tell whether samples were lost."
        if check.lost is None
        else f"Lost samples, in which all encoders read the same again: {check.lost * check.told / 3600.0:.0f} in"
        f" the {check.told:.0f} s in which one would have shown, or {check.lost:.0f} an hour."
    )
    late = (
        f"From a command until the encoders show that it acts: {1e3 * delay.value:.1f} ±"
        f" {1e3 * NINETY_FIVE * delay.deviation:.1f} ms (95 %) beside the lag of the drives"
    )
    told = "." if delay.told else ", which is all but what the data sheet says: the data do not tell more."
    return [
        heading("Sensors"),
        table(
            ["encoder", "step", "noise mrad", "at rest mrad", "spikes an hour", "smallest that shows, mrad"],
            rows,
        ),
        paragraph(
            "Noise is the standard deviation of the readings about a smooth motion, rounding to steps included. At"
            " rest an encoder whose noise is small beside its step stands still."
        ),
        paragraph(lost),
        paragraph(f"Ticks that the log lacks: {check.missing:.0f} an hour."),
        paragraph(late + told),
    ]


def _numbers(record: MachineRecord) -> list[str]:
    rows, untold = [], []
    for name, number in record.numbers.items():
        words, unit = quantity(name)
        expected = f"{number.expected:.4g} ± {NINETY_FIVE * number.tolerance:.2g}"
        if number.told:
            away = (number.value - number.expected) / number.tolerance
            rows.append([f"{name}: {words}", interval(number), expected, unit, f"{away:+.1f}"])
        elif number.deviation:
            untold.append(f"{name}: {words}, {expected} {unit}".rstrip())
    kept = [name for name, number in record.numbers.items() if not number.deviation]
    return [
        heading("Numbers"),
        table(["", "identified, 95 %", "data sheet, 95 %", "unit", "away, in its deviations"], rows),
        *_load(record),
        heading("What the data do not tell"),
        paragraph("Of these the data sheet tells nearly all that is known; the values used stay near its."),
        bullets(untold),
        paragraph(f"Taken from the data sheet without a look at the data: {', '.join(kept)}."),
    ]


def _load(record: MachineRecord) -> list[str]:
    why = "Motion without a box tells ratios of torques only; their scale is the data sheet's, with its tolerance."
    return [] if record.load is None else [paragraph(f"{load(record.load).capitalize()}. {why}")]


def _fit(identified: Identified, record: MachineRecord) -> list[str]:
    seconds = sum(map(len, identified.measured)) * PERIOD
    return [
        heading("Fit on held-out motion"),
        table(
            ["", "fit", "not explained mrad", "noise of the encoder mrad"],
            [
                [f"joint {joint}", f"{fit:.4f}", f"{1e3 * left:.2f}", f"{1e3 * noise:.2f}"]
                for joint, (fit, left, noise) in enumerate(
                    zip(record.fit, record.unexplained, record.encoders, strict=True), 1
                )
            ],
        ),
        picture(
            vector_graphics(_curves(identified)),
            f"Readings and what the model predicts of them: {len(identified.measured)} segments of motion,"
            f" {seconds:.0f} s in all, to which it was not fitted. Only the state at the start of each is estimated.",
        ),
        paragraph("What is left:"),
        bullets(
            record.remarks or ["Nothing that depends on angle, speed, direction or voltage, and little but noise."]
        ),
        *([] if record.converged else [paragraph("The search did not end at a minimum.")]),
    ]


def _curves(identified: Identified) -> Figure:
    figure = new_figure(11, 7.5)
    axes = figure.subplots(3, 2, sharex=True, gridspec_kw={"width_ratios": (3, 2)})
    start = 0.0
    for measured, predicted in zip(identified.measured, identified.predicted, strict=True):
        read, said = np.array(measured), np.array(predicted)
        t = start + PERIOD * np.arange(len(read))
        for joint in range(3):
            axes[joint, 0].plot(t, read[:, joint], color=DARK, lw=2.2, alpha=0.5)
            axes[joint, 0].plot(t, said[:, joint], color=COLOURS[0], lw=1.0)
            axes[joint, 1].plot(t, 1e3 * (read - said)[:, joint], color=RED, lw=0.7)
        start = t[-1] + PERIOD
    for joint in range(3):
        axes[joint, 0].set_ylabel(f"joint {joint + 1}, rad")
        axes[joint, 1].axhline(0.0, color=DARK, lw=0.5)
        axes[joint, 1].set_ylabel("left, mrad")
    axes[0, 0].set_title("read (grey), predicted (blue)", fontsize=10)
    axes[0, 1].set_title("read minus predicted", fontsize=10)
    for side in (0, 1):
        axes[2, side].set_xlabel("s of held-out motion")
    return figure


def _settings(record: MachineRecord) -> list[str]:
    found = record.settings
    if found is None:
        return [heading("Settings of the controller"), paragraph("Nobody has designed settings for this arm.")]
    control, low, high = found.control, *found.late
    model = control.model
    rows = [
        ["Kp, 1/s²", *(f"{value:g}" for value in control.gains.kp)],
        ["Ki, 1/s³", *(f"{value:g}" for value in control.gains.ki)],
        ["Kd, 1/s", *(f"{value:g}" for value in control.gains.kd)],
        ["friction MU, N m", *(f"{value:.4f}" for value in model.coulomb)],
        ["inertia I with the rotor, kg m²", *(f"{value:.3g}" for value in model.inertia)],
    ]
    compensation = control.compensation
    verdict = (
        paragraph(f"They must not be used: {found.refused}.", "grade poor")
        if found.refused
        else paragraph("Every margin that is demanded at the places is there.", "grade good")
    )
    return [
        heading("Settings of the controller"),
        verdict,
        table([f"law {control.law}", "joint 1", "joint 2", "joint 3"], rows),
        paragraph(
            f"DELAY {1e3 * compensation.delay:.1f} ms, DEAD_ZONE {compensation.dead_zone:.3f} V, BANDWIDTH of the"
            f" observer {compensation.bandwidth:g} rad/s. The model has the identified masses, inertias and damping."
        ),
        table(
            ["least margins", "disk", "gain dB", "phase °", "delay ticks", "one motor's torque"],
            [
                ["demanded", *_margins(MARGINS)],
                ["at the places", *_margins(found.places)],
                ["in the workspace", *_margins(found.workspace)],
            ],
        ),
        paragraph(
            f"With and without a box, on the identified arm, which obeys a command {low:.2f} to {high:.2f} ticks"
            f" later. The noise of the encoders makes up to {found.noise:.2f} V of a voltage (standard deviation)."
        ),
        bullets(found.remarks),
    ]


def _margins(found: Demands | LeastMargins) -> list[str]:
    return [
        f"{found.disk:.2f}",
        f"{found.gain:.1f}",
        f"{found.phase:.0f}",
        f"{found.delay:.2f}",
        f"{found.torque:.0%}",
    ]


def _monitor(record: MachineRecord) -> list[str]:
    healthy = record.healthy
    if healthy is None:
        return [heading("Monitor"), paragraph("Nobody has watched the healthy arm: the monitor is not calibrated.")]
    alarm = threshold(ALARMS_PER_HOUR, Tail())
    more = dict(zip(JUMPS, allowances(ALARMS_PER_HOUR, commissioned(record).tails).tolist(), strict=True))
    charged = ", ".join(f"{fault} {alarm + beyond:.0f}" for fault, beyond in more.items() if beyond > 0.5)
    slow = ", ".join(f"{1e3 * torque:.0f}" for torque in healthy.slow)
    return [
        heading("Monitor"),
        paragraph(
            f"The healthy arm was watched for {healthy.duration:.0f} s. An alarm is given from a statistic of"
            f" {alarm:.0f} on, which stands for {ALARMS_PER_HOUR:g} false alarms an hour."
            f" For faults that look like what the model lacks it is more: {charged or 'there are none'}."
        ),
        paragraph(
            f"The model leaves torques of {slow} mN m (standard deviations of the joints) that last"
            f" {healthy.memory:g} s, the gears play of {1e3 * healthy.displacement:g} mrad and compliances of"
            f" {compliances(healthy.compliance)} mrad/(N m)."
        ),
    ]


def _made(record: MachineRecord) -> list[str]:
    versions = ", ".join(f"{name} {version}" for name, version in record.versions.items())
    return [
        heading("How it was made"),
        paragraph(f"{record.segments} segments of motion were fitted. SHA-256 of these data: {record.data}."),
        paragraph(f"Versions: {versions}. Format of the record: {record.schema}."),
    ]

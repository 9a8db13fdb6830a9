"""The page of a run of a line: throughput, what stations and vehicles did, where time was lost, what was decided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from dtwin.commissioning.html import document, escaped, heading, paragraph, picture, table
from dtwin.line.records.kept import Kept

STATES: Final = ("waits", "works", "stopped", "blocked")
"""What a station does, by the number in a sample."""
_STATION_COLOURS: Final = ("#e6e6e6", "#4878a8", "#c44e52", "#ccb974")
_PHASE_COLOURS: Final = {0: "#e6e6e6", 1: "#a8c4de", 2: "#4878a8", 9: "#55a868"}
_WIDTH, _LEFT, _ROW = 900.0, 90.0, 22.0
_WINDOW: Final = 60.0
"""Time over which throughput is told, s."""


@dataclass(frozen=True, slots=True)
class Effectiveness:
    """Overall equipment effectiveness of a station (ISO 22400-2): the product of three shares.

    Attributes:
        availability: of the time, in which it was not stopped.
        performance: of that, in which it worked; it waits for boxes or for their removal in the rest.
        quality: of its boxes, that were not lost.
        blocked: of the time, in which it waited for a finished box to be fetched.
    """

    availability: float
    performance: float
    quality: float
    blocked: float

    @property
    def overall(self) -> float:
        """The product of the three."""
        return self.availability * self.performance * self.quality


def effectiveness(run: Kept, station: str) -> Effectiveness:
    """That of a station in a run."""
    place = run.stations.index(station)
    states = [sample.stations[place] for sample in run.samples]
    total, stopped, works = len(states) or 1, states.count(2), states.count(1)
    done = sum(event.kind == "done" and event.who == station for event in run.events)
    lost = sum(event.kind == "lost" and event.who == station for event in run.events)
    up = total - stopped
    return Effectiveness(
        up / total, works / up if up else 0.0, done / (done + lost) if done + lost else 1.0, states.count(3) / total
    )


def throughput(run: Kept, since: float = 0.0, until: float | None = None) -> float:
    """Boxes an hour that left between two times, s."""
    end = run.duration if until is None else until
    left = [time for time in run.left if since < time <= end]
    return 3600.0 * (len(left) - 1) / (left[-1] - left[0]) if len(left) > 1 else 0.0


def page(run: Kept) -> str:
    """The page."""
    rows = []
    for name in run.stations:
        found = effectiveness(run, name)
        shares = (found.availability, found.performance, found.quality, found.overall, found.blocked)
        rows.append([name, *(f"{100 * share:.1f} %" for share in shares)])
    decisions = [[f"{d.time:.1f}", d.who, d.what, d.why] for d in run.decisions]
    words = (
        f"{len(run.left)} of {run.entered} boxes left in {run.duration:.0f} s of plant time, {throughput(run):.1f} an"
        f" hour from the first to the last; {run.lost} were lost; vehicles touched {run.collisions} times."
    )
    return document(
        f"Line {run.line}",
        [
            paragraph(words, "grade good" if not run.lost and not run.collisions else "grade poor"),
            heading("Throughput"),
            picture(_throughput(run), f"Boxes that left in the {_WINDOW:.0f} s before, as boxes an hour."),
            heading("What stations did"),
            picture(_stations(run), "Grey waits, blue works, red is stopped, yellow waits for a vehicle."),
            heading("What vehicles did"),
            picture(_vehicles(run), "Light blue drives or waits without a box, blue has one, green charges at home."),
            heading("Effectiveness"),
            table(["station", "availability", "performance", "quality", "overall", "blocked"], rows),
            heading("What was decided, and why"),
            table(["s", "who", "what", "why"], decisions, "words") if decisions else paragraph("Nothing."),
        ],
    )


def summary(run: Kept) -> dict[str, object]:
    """What a run came to, in numbers."""
    return {
        "line": run.line,
        "duration": run.duration,
        "entered": run.entered,
        "left": len(run.left),
        "lost": run.lost,
        "collisions": run.collisions,
        "boxes_per_hour": round(throughput(run), 3),
        "oee": {name: round(effectiveness(run, name).overall, 4) for name in run.stations},
        "decisions": [f"{d.time:.1f} s {d.who}: {d.what}: {d.why}" for d in run.decisions],
    }


def _stations(run: Kept) -> str:
    return _gantt(
        run, run.stations, lambda k: [s.stations[k] for s in run.samples], dict(enumerate(_STATION_COLOURS))
    )


def _vehicles(run: Kept) -> str:
    return _gantt(run, run.vehicles, lambda k: [s.vehicles[k] for s in run.samples], _PHASE_COLOURS)


def _gantt(run: Kept, names: Sequence[str], states: Callable[[int], list[int]], colours: dict[int, str]) -> str:
    """A bar for each name, in the colour of what it did."""
    scale = (_WIDTH - _LEFT) / max(run.duration, 1.0)
    parts = []
    for row, name in enumerate(names):
        y, x = _ROW * row, _LEFT
        parts.append(f'<text x="0" y="{y + 15:.0f}" font-size="13">{escaped(name)}</text>')
        for state, group in groupby(states(row)):
            width = scale * len(list(group))
            parts.append(
                f'<rect x="{x:.2f}" y="{y + 3:.0f}" width="{width:.2f}" height="{_ROW - 6:.0f}"'
                f' fill="{colours.get(state, "#000000")}"/>'
            )
            x += width
    return _svg(parts, run, _ROW * len(names))


def _throughput(run: Kept) -> str:
    """A line over time."""
    height, scale = 130.0, (_WIDTH - _LEFT) / max(run.duration, 1.0)
    times = [sample.time for sample in run.samples]
    values = [3600.0 / min(_WINDOW, max(t, 1.0)) * sum(t - _WINDOW < left <= t for left in run.left) for t in times]
    top = max([*values, 1.0])
    points = " ".join(
        f"{_LEFT + scale * t:.1f},{height - 5 - (height - 15) * v / top:.1f}"
        for t, v in zip(times, values, strict=True)
    )
    parts = [
        f'<text x="0" y="15" font-size="13">{top:.0f} /h</text>',
        f'<text x="0" y="{height - 5:.0f}" font-size="13">0</text>',
        f'<polyline points="{points}" fill="none" stroke="#4878a8" stroke-width="1.5"/>',
    ]
    return _svg(parts, run, height)


def _svg(parts: list[str], run: Kept, height: float) -> str:
    """A drawing with an axis of time, and a mark for every decision that changes something."""
    scale = (_WIDTH - _LEFT) / max(run.duration, 1.0)
    step = next((s for s in (10, 30, 60, 300, 600, 3600) if run.duration / s <= 12), 36000)
    for k in range(int(run.duration // step) + 1):
        x = _LEFT + scale * k * step
        parts.append(f'<text x="{x:.1f}" y="{height + 14:.0f}" font-size="11" fill="#666">{k * step} s</text>')
    for decision in run.decisions:
        if decision.what in ("stop", "settings", "set-up", "repair"):
            x = _LEFT + scale * decision.time
            parts.append(f'<path d="M{x:.1f} 0V{height:.0f}" stroke="#222" stroke-dasharray="3 3"/>')
    box = f"0 0 {_WIDTH:.0f} {height + 20:.0f}"
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}">{"".join(parts)}</svg>'

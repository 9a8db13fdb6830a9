"""A page of the console without a cell: what it is told is made up, and what it asks for is kept.

The page's own files are served from the project; the messages are those of the console's types.
"""

import json
import math
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import msgspec
from playwright.sync_api import Page, Route, expect

from dtwin.bus.messages import Latency
from dtwin.bus.twin_messages import (
    UNITS,
    Estimated,
    IdentificationState,
    MonitoredUnit,
    MonitoringVerdict,
    Upload,
    WatchState,
)
from dtwin.console.alarms.export import COLUMNS
from dtwin.console.alarms.states import Alarm
from dtwin.console.commands import COMMANDS
from dtwin.console.conditions import conditions
from dtwin.console.console import You
from dtwin.console.telling import CellState, Frame, Health, spots
from dtwin.console.web.server import STATIC
from dtwin.parameters import ArmParameters, Gains
from dtwin.signals import BoxCounts, Event
from dtwin.task import DEFAULT_TASK

ADDRESS: Final = "http://console.test/"
ROWS: Final = 1200
"""Number of frames that are there when the page opens: a minute."""
_TYPES: Final = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
WEAK: Final = MonitoredUnit(
    *("failed", "motor_constant", "K2", -0.9, 0.004, 0.98, 61.2, 61.4, True),
    "motor constant of joint 2, -90.0 % +- 0.4 %, confidence 98 %, since 61.20 s",
)
BIASED: Final = MonitoredUnit(
    *("may be degrading", "encoder_offset", "bias3", 0.0123, 0.0004, 0.91, 40.0, 42.0, True),
    "encoder offset of joint 3, +12.3 +- 0.4 mrad, confidence 91 %, since 40.00 s",
)


def settings(**changes: Any) -> Upload:
    """The settings in force."""
    gains, predicted = Gains((200.0, 500.0, 300.0), (75.0, 200.0, 150.0), (2.0, 2.0, 2.0)), (0.01, 0.02, 0.015)
    usual = Upload(3, 12.3, "upload", "as found", True, gains, 2.0, "cascade", ArmParameters(), predicted)
    return msgspec.structs.replace(usual, **changes)


def verdict() -> MonitoringVerdict:
    """A weak motor, and an encoder that is off."""
    units = {name: MonitoredUnit("nominal") for name in UNITS} | {"joint 2": WEAK, "joint 3": BIASED}
    return MonitoringVerdict(70.0, units, ("damping of joint 1 is +30.0 %: limit +50 % in 2.0 h",), ("mu3",), 0, 1)


def state(**changes: Any) -> CellState:
    """A cell with something to tell on every display."""
    names = ("bridge", "console", "controller", "emulator", "identification", "monitoring", "recorder", "simulation")
    services = {name: Health("running", rate_hz=100.0) for name in names}
    found = {f"K{joint}": Estimated(0.27, 0.004) for joint in (1, 2, 3)}
    usual = CellState(
        "cell",
        "arm",
        "the arm fetches a green box",
        services=services,
        ticks=120_000,
        late_ticks=2,
        real_time_factor=1.0,
        latency_ms=Latency(0.84, 1.92, 6.0, 0.0),
        boxes=BoxCounts(12, 1, 11, 9, 1, 1),
        verdict=verdict(),
        watch=WatchState(True, "the data sheet's arm"),
        identification=IdentificationState(
            "proposed", "a model of 3 parameters", 350, 350, True, True, 3, found, (0.99, 0.98, 0.97)
        ),
        settings=settings(),
        places=spots(DEFAULT_TASK),
        events=tuple(Event(float(k), "delivered", f"the green box {k} is at its place") for k in range(30)),
    )
    made = msgspec.structs.replace(usual, **changes)
    abnormal = conditions(made.services, made.stop, made.verdict, made.settings, 0.0)
    return msgspec.structs.replace(made, conditions=abnormal)


def frame(theta: tuple[float, float, float] = (0.9, -1.1, -1.2)) -> Frame:
    """What frames sway about."""
    box, small = DEFAULT_TASK.colours[0], (0.001, 0.001, 0.001)
    return Frame(0.0, 0.0, 0.0, theta, theta, (2.1, -4.4, 0.3, 0.0), 0.6, False, box, theta, small, small, 3.1, 31.0)


def alarms() -> dict[str, Any]:
    """One alarm that nobody has answered for each finding, and one of the trial."""
    shown = [
        Alarm("finding/joint 2/K2", f"joint 2: {WEAK.text}", "high", "change it", True, True, 1.0, 61.4, count=1),
        Alarm("finding/joint 3/bias3", f"joint 3: {BIASED.text}", "medium", "see it", True, True, 1.0, 42.0, count=1),
        Alarm("event/roll_back", "rolled back", "medium", "see Simulation", False, True, 1.0, 30.0, count=2),
    ]
    told = [{**msgspec.to_builtins(each), "state": each.state.value} for each in shown]
    return {"tell": "alarms", "alarms": told, "rate": 3, "flood": False, "floods": 0, "left_out": 0, "trouble": ""}


def motions(names: tuple[str, ...]) -> dict[str, Any]:
    """What a simulation answers."""
    time = [0.02 * k for k in range(200)]
    path = [[0.5 * math.sin(t) for t in time] for _ in range(3)]
    figures = {
        "tracking_max": (0.0123, 0.0456, 0.0111),
        "settling_time": 2.31,
        "final_error": (0.0001, 0.0002, 0.0001),
        "peak_volts": (4.1, 7.9, 2.2),
        "saturated": 0.01,
        "energy": 3.4,
    }
    made = [
        {
            "name": name,
            "time": time,
            "path": path,
            "theta": [[v + 0.01 * (n + 1) * math.sin(2 * t) for v, t in zip(row, time, strict=True)] for row in path],
            "volts": [[4.0 * math.sin(t + n) for t in time] for _ in range(3)],
            "figures": figures,
        }
        for n, name in enumerate(names)
    ]
    return {"motions": made}


class MadeUp:
    """A page, and what it is told.

    Args:
        page: page of a browser.
        shown: state of the cell.
        at: frame that the arm sways about.
        entries: history of the settings.

    Attributes:
        page: the page.
        asked: addresses and contents of what the page has asked for by posting, in order.
    """

    def __init__(
        self,
        page: Page,
        shown: CellState | None = None,
        at: Frame | None = None,
        entries: list[dict[str, Any]] | None = None,
    ) -> None:
        self.page = page
        self.asked: list[tuple[str, Any]] = []
        self._entries = _entries() if entries is None else entries
        self._jobs: list[Any] = []
        told = shown or state()
        blocked = {name: command.blocked(told) for name, command in COMMANDS.items()}
        given = {
            "you": You("anna", "engineer", "anna", True, blocked),
            "state": told,
            "alarms": alarms(),
            "frame": at or frame(),
            "rows": ROWS,
        }
        script = (Path(__file__).parent / "made_up.js").read_text()
        page.add_init_script(f"window.MADE_UP = {msgspec.json.encode(given).decode()};\n{script}")
        page.route(f"{ADDRESS}**", self._serve)

    def open(self, display: str = "overview") -> Page:
        """Opens a display and waits until it is drawn."""
        self.page.goto(f"{ADDRESS}#{display}")
        expect(self.page.locator("#live")).to_have_text("● live", timeout=20_000)
        expect(self.page.locator("main")).to_have_attribute("data-display", display)
        drawn(self.page)
        return self.page

    def turn(self, display: str) -> None:
        """Changes to another display."""
        self.page.evaluate("(name) => { location.hash = name; }", display)
        expect(self.page.locator("main")).to_have_attribute("data-display", display)
        drawn(self.page)

    def _serve(self, route: Route) -> None:
        path = urlsplit(route.request.url).path
        if path == "/":
            path = "/static/index.html"
        if path.startswith("/static/"):
            file = STATIC / path.removeprefix("/static/")
            route.fulfill(body=file.read_bytes(), content_type=_TYPES[file.suffix])
            return
        answer = self._post(path, route.request.post_data) if route.request.method == "POST" else self._get(path)
        route.fulfill(body=json.dumps(answer), content_type="application/json")

    def _post(self, path: str, content: str | None) -> Any:
        form = json.loads(content or "{}")
        self.asked.append((path, form))
        if path.startswith("/api/job/"):
            simulated = path == "/api/job/simulate"
            names = tuple(each["name"] for each in form["candidates"]) if simulated else ()
            self._jobs.append(motions(names) if simulated else None)
            return {"done": True, "job": len(self._jobs)}
        return {"done": True, "text": "done"}

    def _get(self, path: str) -> Any:
        if path.startswith("/api/job/"):
            found = self._jobs[int(path.split("/")[3]) - 1]
            return {"over": True, "result": found, "error": "" if found else "made up: there is no search"}
        told: dict[str, Any] = {
            "/api/session": {"token": "t", "user": "anna", "role": "engineer", "login": False, "viewer": ""},
            "/api/history": {"entries": self._entries},
            "/api/models": {"models": ["arm@1"]},
            "/api/logs": {"logs": []},
            "/api/alarms": {"columns": COLUMNS, "rows": [("1",) * len(COLUMNS)]},
        }
        return told[path]


def drawn(page: Page) -> None:
    """Waits until the page has drawn twice."""
    page.wait_for_function("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def _entries() -> list[dict[str, Any]]:
    changed = [("K2", 0.27, 0.216), ("payload", 0.2, 0.15)]
    common: dict[str, Any] = {"who": "anna", "why": "try", "kind": "gains", "text": "", "changed": changed}
    return [
        {"version": 1, "time": 0.0, "action": "start", **common, "changed": []},
        {"version": 3, "time": 12.3, "action": "upload", **common},
    ]

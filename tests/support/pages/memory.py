"""Measures what the memory of a page grows by, with the overview open at a cell in real time."""

import os
import statistics
import sys
import time
from tempfile import TemporaryDirectory

from playwright.sync_api import CDPSession, sync_playwright

from dtwin.services import runfile
from tests.support.desk import new_desk
from tests.support.pages.browsers import ARGUMENTS, find_chromium
from tests.support.waiting import until

EVERY = 30.0
"""Time between two looks at the memory, s."""
FILLING = 90.0
"""Time in which the trends fill their arrays, s; what is seen meanwhile does not count."""
COLLECTIONS = 10
"""Number of collections of garbage at each look: what comes between one and its reading is no growth."""
HALF_HOUR = 1800.0
"""s"""


def main() -> int:
    """Measures for the time that is given, ten minutes otherwise."""
    words = sys.argv[1:]
    seconds = float(words[words.index("--seconds") + 1]) if "--seconds" in words else 600.0
    chromium = find_chromium()
    if chromium is None:
        print("needs a browser: apt install chromium, or set CHROMIUM to the path of one", file=sys.stderr)
        return 2
    with TemporaryDirectory() as work, new_desk() as desk, sync_playwright() as play:
        os.chdir(work)
        desk.detach("--monitoring", "--console")
        browser = play.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(runfile.require("cell").console)
        until(lambda: "live" in page.locator("#live").inner_text(), "the page is live", 60.0)
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable")
        seen = _watched(session, seconds)
        print(_growth(seen), flush=True)
        browser.close()
        desk.run("down")
    return 0


def _watched(session: CDPSession, seconds: float) -> list[tuple[float, float]]:
    """Times (s) and memory (MB) of the looks that count."""
    seen: list[tuple[float, float]] = []
    print("time_s heap_mb nodes listeners", flush=True)
    began = time.monotonic()
    while (now := time.monotonic() - began) < seconds:
        looks = [_collected(session) for _ in range(COLLECTIONS)]
        found = min(looks, key=lambda look: look["JSHeapUsedSize"])
        used = found["JSHeapUsedSize"] / 1e6
        print(f"{now:.0f} {used:.3f} {found['Nodes']:.0f} {found['JSEventListeners']:.0f}", flush=True)
        if now >= FILLING:
            seen.append((now, used))
        time.sleep(EVERY)
    return seen


def _collected(session: CDPSession) -> dict[str, float]:
    """The page's metrics right after a collection of garbage."""
    session.send("HeapProfiler.collectGarbage")
    return {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}


def _growth(seen: list[tuple[float, float]]) -> str:
    """What the straight line through the looks grows by in half an hour."""
    if len(seen) < 2:
        return f"too few looks: expected more than {FILLING + EVERY:g} s"
    slope, _ = statistics.linear_regression(*zip(*seen, strict=True))
    share = HALF_HOUR * slope / seen[0][1]
    return f"growth in 30 minutes: {HALF_HOUR * slope:+.3f} MB, {100 * share:+.1f} % of {seen[0][1]:.3f} MB"


if __name__ == "__main__":
    sys.exit(main())

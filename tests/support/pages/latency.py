"""Measures five browsers at a console: from a sample to its pixels, and the cell beside it."""

import json
import os
import sys
import time
from functools import partial
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import sync_playwright

from dtwin.services import runfile
from tests.support.desk import Desk, new_desk
from tests.support.pages.browsers import ARGUMENTS, find_chromium
from tests.support.waiting import until

BROWSERS = 5
LATENCY = """async () => {
    const { store } = await import("/static/js/store.js");
    return Array.from(store.latencies.subarray(0, Math.min(store.measured, store.latencies.length)));
}"""


def main() -> int:
    """Measures for the time that is given, one minute otherwise."""
    words = sys.argv[1:]
    seconds = float(words[words.index("--seconds") + 1]) if "--seconds" in words else 60.0
    chromium = find_chromium()
    if chromium is None:
        print("needs a browser: apt install chromium, or set CHROMIUM to the path of one", file=sys.stderr)
        return 2
    with TemporaryDirectory() as work:
        os.chdir(work)
        figures = {"without": _alone(seconds), **_watched(chromium, seconds)}
    for name, value in figures.items():
        print(f"{name}: {json.dumps(value)}")
    return 0


def _cell(desk: Desk) -> dict[str, Any]:
    summary = desk.summary()
    return {name: summary[name] for name in ("ticks", "late_ticks", "real_time_factor", "latency_ms")}


def _alone(seconds: float) -> dict[str, Any]:
    """The cell without a console."""
    with new_desk() as desk:
        desk.detach("--monitoring")
        time.sleep(seconds)
        found = _cell(desk)
        desk.run("down")
    return found


def _watched(chromium: str, seconds: float) -> dict[str, Any]:
    """The cell with a console and browsers, and what these have measured."""
    with new_desk() as desk, sync_playwright() as play:
        desk.detach("--monitoring", "--console")
        address = runfile.require("cell").console
        browser = play.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        pages = [browser.new_context(viewport={"width": 1280, "height": 720}).new_page() for _ in range(BROWSERS)]
        for page in pages:
            page.goto(address)
        for page in pages:
            until(partial(page.evaluate, LATENCY), "frames are drawn", 60.0)
        time.sleep(seconds)
        latencies = sorted(value for page in pages for value in page.evaluate(LATENCY))
        found = {
            "with": _cell(desk),
            "sample_to_pixels_ms": {
                "median": latencies[len(latencies) // 2],
                "p95": latencies[int(0.95 * len(latencies))],
                "browsers": BROWSERS,
            },
        }
        browser.close()
        desk.run("down")
    return found


if __name__ == "__main__":
    sys.exit(main())

"""Pages of a browser that are used again: a new one starts processes, which takes as long as two loads."""

from typing import Any, Final

from playwright.sync_api import Browser, Error, Page, ViewportSize

SIZE: Final[ViewportSize] = {"width": 1280, "height": 720}


class Pages:
    """The pages of a browser, each in a context of its own, which knows nothing of those who had it before."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._free: dict[str, list[Page]] = {}

    def take(self, options: dict[str, Any]) -> Page:
        """An empty page whose context has these options; nobody else has it meanwhile."""
        free = self._free.get(repr(options))
        return free.pop() if free else self._browser.new_context(viewport=SIZE, **options).new_page()

    def give_back(self, page: Page, options: dict[str, Any]) -> None:
        """Forgets what was on a page; one that does not forget is closed."""
        try:
            page.evaluate("localStorage.clear(); sessionStorage.clear()")
            page.context.clear_cookies()
            page.set_viewport_size(SIZE)
            page.goto("about:blank")
        except Error:
            page.context.close()
        else:
            self._free.setdefault(repr(options), []).append(page)

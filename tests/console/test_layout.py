"""How the displays look: what fits the screen, what does not overlap, and what is drawn; the cell is made up."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from dtwin.console.telling import Health
from tests.support.pages.browsers import DISPLAYS
from tests.support.pages.made_up import MadeUp, drawn, frame, state

OVERPRINTED = """() => {
    const boxes = (nodes) => nodes.flatMap((node) => {
        const range = document.createRange();
        range.selectNodeContents(node);
        return [...range.getClientRects()].map((box) => ({ box, text: node.textContent }));
    });
    const texts = boxes([...document.querySelectorAll(".readings dt, .readings dd, .joints h3")]);
    const apart = (a, b) => a.right <= b.left || b.right <= a.left || a.bottom - 1 <= b.top || b.bottom - 1 <= a.top;
    return texts.flatMap((one, k) => texts.slice(k + 1).filter((two) => !apart(one.box, two.box))
        .map((two) => `${one.text} over ${two.text}`));
}"""
"""Texts of the joints that stand over each other."""
OFF_CANVAS = """async (size) => {
    const { drawArm } = await import("/static/js/arm.js");
    const { store } = await import("/static/js/store.js");
    const canvas = document.createElement("canvas");
    canvas.className = "arm";
    canvas.style.width = `${size[0]}px`;
    canvas.style.height = `${size[1]}px`;
    document.body.append(canvas);
    const context = canvas.getContext("2d");
    const off = [];
    for (const name of ["moveTo", "lineTo"]) {
        const plain = context[name].bind(context);
        context[name] = (x, y) => {
            if (x < 0 || y < 0 || x > size[0] || y > size[1]) off.push([x, y]);
            plain(x, y);
        };
    }
    for (let turn = 0; turn < 8; turn += 1) {
        drawArm(canvas, { theta: [turn * Math.PI / 4, 0, 0], gripper: 0.9 }, store.state.places);
    }
    canvas.remove();
    return off;
}"""
"""Ends of lines that are not on the canvas, of the arm stretched out in eight directions."""
WORDS = """async ([module, name, content]) => {
    const drawing = (await import(module))[name];
    const canvas = document.createElement("canvas");
    canvas.className = "trend";
    document.body.append(canvas);
    const context = canvas.getContext("2d");
    const texts = [];
    const write = context.fillText.bind(context);
    context.fillText = (text, ...place) => { texts.push(text); write(text, ...place); };
    drawing(canvas, content);
    canvas.remove();
    return texts;
}"""
"""Texts that a module draws on a canvas."""


@pytest.fixture(scope="module")
def made_up(browser: Browser) -> Iterator[MadeUp]:
    """Angles with as many digits as there can be, one of them beyond its scale; a service in trouble."""
    usual = state()
    services = usual.services | {"simulation": Health("silent")}
    with browser.new_context(viewport={"width": 1280, "height": 720}) as context:
        made_up = MadeUp(context.new_page(), state(services=services), frame((-0.67, -2.67, -4.2)))
        made_up.open()
        yield made_up


@pytest.fixture
def page(made_up: MadeUp) -> Page:
    """The overview at 1280 x 720."""
    resize(made_up.page, 1280, 720)
    made_up.turn("overview")
    return made_up.page


def resize(page: Page, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    drawn(page)


@pytest.mark.parametrize("width", [820, 1024, 1280, 3840])
def test_no_text_of_the_joints_stands_over_another(page: Page, width: int) -> None:
    resize(page, width, 900)
    readings = page.locator(".readings dd")
    expect(readings.first).not_to_have_text("–")
    assert page.evaluate(OVERPRINTED) == []
    assert readings.evaluate_all("(nodes) => nodes.filter((node) => node.scrollWidth > node.clientWidth).length") == 0


@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080), (3840, 2160)])
def test_the_overview_is_as_high_as_the_screen(page: Page, size: tuple[int, int]) -> None:
    resize(page, *size)
    assert page.evaluate("document.documentElement.scrollHeight") == size[1]
    cut = page.locator(".overview .panel").evaluate_all(
        "(nodes) => nodes.filter((node) => node.scrollHeight > node.clientHeight + 1).map((node) => node.innerText)"
    )
    assert cut == []
    assert page.locator(".overview").evaluate("(node) => node.getBoundingClientRect().bottom") > 0.97 * size[1]


@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080), (3840, 2160)])
def test_no_display_is_higher_than_the_screen(made_up: MadeUp, size: tuple[int, int]) -> None:
    resize(made_up.page, *size)
    for display in DISPLAYS:
        made_up.turn(display)
        assert made_up.page.evaluate("document.documentElement.scrollHeight") == size[1], display
        panels = made_up.page.locator("main .panel")
        assert panels.evaluate_all("(nodes) => Math.min(...nodes.map((node) => node.clientHeight))") > 60, display


def test_type_and_drawings_grow_with_the_screen(page: Page) -> None:
    size = "parseFloat(getComputedStyle(document.querySelector('h1')).fontSize)"
    scale = "document.querySelector('canvas.arm').getContext('2d').getTransform().a"
    stop = "document.querySelector('#stop').clientHeight"
    usual = page.evaluate(f"[{size}, {scale}, {stop}]")
    assert usual[0] >= 15
    resize(page, 3840, 2160)
    assert page.evaluate(f"[{size}, {scale}, {stop}]") == pytest.approx([2.0 * each for each in usual], rel=0.1)


def test_on_a_phone_what_is_entered_can_be_read(made_up: MadeUp) -> None:
    resize(made_up.page, 360, 740)
    made_up.turn("identification")
    fields = made_up.page.locator("main .form > input")
    assert fields.evaluate_all("(nodes) => Math.min(...nodes.map((node) => node.clientWidth))") > 100


@pytest.mark.parametrize("width", [820, 1280, 3840])
def test_no_display_is_wider_than_the_screen(made_up: MadeUp, width: int) -> None:
    resize(made_up.page, width, 720)
    for display in DISPLAYS:
        made_up.turn(display)
        assert made_up.page.evaluate("document.documentElement.scrollWidth") <= width, display


@pytest.mark.parametrize("size", [(300, 260), (200, 500), (700, 150)])
def test_the_arm_is_drawn_whole_wherever_it_points(page: Page, size: tuple[int, int]) -> None:
    assert page.evaluate(OFF_CANVAS, size) == []


def test_a_value_beyond_its_scale_is_marked(page: Page) -> None:
    def said(value: float) -> list[str]:
        scale = {"low": -3.8, "high": 3.8, "value": value}
        found: list[str] = page.evaluate(WORDS, ["/static/js/indicator.js", "drawIndicators", [scale]])
        return found

    assert said(3.7) == []
    assert said(4.0) == ["↑ off scale"]
    assert said(-4.0) == ["↓ off scale"]


def test_curves_begin_at_zero_and_name_their_lines(page: Page) -> None:
    curve = {"x": [0.0, 1.0, 4.0], "y": [0.0, 2.0, 1.0]}
    lines = [{**curve, "name": "in force"}, {**curve, "name": "the form"}]
    content = {"title": "Joint 1", "unit": "mrad", "across": "s", "lines": lines, "empty": "nothing"}
    texts = page.evaluate(WORDS, ["/static/js/curves.js", "drawCurves", content])
    assert {"in force", "the form", "0", "4.00 s"} <= set(texts)
    assert not any(text.startswith("-0.2") for text in texts)


def test_services_in_trouble_come_first(page: Page) -> None:
    expect(page.get_by_role("region", name="Services").locator("tbody tr").first).to_contain_text("simulation")

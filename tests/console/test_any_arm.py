"""The console of an arm of n joints in a browser: every joint is shown, the arm is drawn, and it can be stopped."""

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from dtwin.emulation.chain.arms import arm_of
from dtwin.equations.kinematics import tool_of
from dtwin.equations.rigid import motion
from tests.support.desk import Desk, new_desk
from tests.support.pages.hand import Hand
from tests.support.waiting import until

STORE = "import('/static/js/store.js').then(({{ store }}) => {})"
JOINTS = ["Base", "Shoulder", "Elbow", "Wrist_1", "Wrist_2", "Wrist_3"]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """A cell with the arm of six axes."""
    with new_desk() as desk, pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("cell"))
        options = ("--machine", "nominal", "--monitoring", "--healthy", "20", "--simulation", "--pace", "lockstep")
        desk.detach("--arm", "six-axis", "--console", *options)
        yield desk
        desk.run("down")


def test_every_joint_is_shown(console_page: Page) -> None:
    page = console_page
    for name in JOINTS:
        expect(page.get_by_role("heading", name=name, exact=True)).to_be_visible()
    assert page.locator("canvas.indicator").count() == len(JOINTS)
    expect(page.locator("#doing")).to_have_text("The arm goes from pose to pose", timeout=20_000)
    value = page.locator(".joints .value").first
    before = value.inner_text()
    expect(value).not_to_have_text(before, timeout=60_000)
    titles = page.locator("nav a:visible").all_inner_texts()
    assert titles == ["Overview", "Models", "Monitoring", "Alarms", "Replay"]


def test_the_arm_is_drawn_where_its_joints_are(console_page: Page) -> None:
    """The places of the joints that the page reckons are those of the chain, at drawn positions."""
    arm = arm_of("six-axis")
    q = np.random.default_rng(4).uniform(-2.0, 2.0, len(arm))
    until(
        lambda: console_page.evaluate(
            "import('/static/js/store.js').then(({ store }) => store.state?.joints?.length)"
        ),
        "joints",
    )
    found = console_page.evaluate(
        """async (positions) => {
            const { store } = await import("/static/js/store.js");
            const { placesOf } = await import("/static/js/chain.js");
            return placesOf(store.state.joints, store.state.tool, positions);
        }""",
        q.tolist(),
    )
    still = np.zeros((1, len(arm)))
    moving = motion(arm, q[None], still, still)
    at, turn, expected = np.zeros(3), np.eye(3), [np.zeros(3)]
    for rotation, translation in zip(moving.rotation, moving.translation, strict=True):
        at, turn = at + turn @ translation[0], turn @ rotation[0]
        expected.append(at)
    expected.append(tool_of(arm, q[None])[0][0])
    assert np.abs(np.array(found) - expected).max() < 1e-12
    painted = """() => {
        const canvas = document.querySelector("canvas.arm");
        const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
        return data.some((value, index) => index % 4 === 3 && value > 0);
    }"""
    until(lambda: console_page.evaluate(painted), "the arm is drawn")


def test_monitoring_and_models_are_shown(console_page: Page) -> None:
    page = console_page
    page.get_by_role("link", name="Monitoring").click()
    for joint in range(1, len(JOINTS) + 1):
        expect(page.get_by_role("cell", name=f"joint {joint}", exact=True)).to_be_visible(timeout=60_000)
    assert page.locator("canvas.trend").count() == 2 * len(JOINTS)
    page.get_by_role("link", name="Models").click()
    expect(page.get_by_text("Version 1")).to_be_visible(timeout=20_000)
    expect(page.get_by_text("There is no identification service.")).to_be_visible()


def test_the_arm_is_stopped_and_released(hand: Hand, console_page: Page, cell: Desk) -> None:
    page = console_page
    hand.stop()
    expect(page.locator("#doing")).to_contain_text("stopped and held", timeout=60_000)
    hand.press("Release the arm")
    hand.confirm()
    expect(page.locator("#doing")).to_have_text("The arm goes from pose to pose", timeout=60_000)


def test_the_last_hour_has_all_joints(console_page: Page) -> None:
    page = console_page
    page.get_by_role("link", name="Replay").click()
    page.get_by_role("button", name="Look at the last hour").click()
    expect(page.locator("#live")).to_have_text("◷ not live: the past", timeout=20_000)
    joints = page.evaluate(
        "import('/static/js/store.js').then(({ store }) => [store.past.trends.joints, store.frame.theta.length])"
    )
    assert joints == [len(JOINTS), len(JOINTS)]


def test_an_arm_in_a_plane_is_seen_along_its_axes(console_page: Page) -> None:
    """The two planar joints of an arm turn counterclockwise on the page, whatever way their axes point."""
    seen = console_page.evaluate("""async () => {
        const { chainView } = await import("/static/js/chain.js");
        const rotation = [1, 0, 0, 0, 1, 0, 0, 0, 1];
        const joint = { turns: true, rotation, translation: [0, 0, 0], axis: [0, -1, 0] };
        const joints = [joint, { ...joint, translation: [1, 0, 0] }];
        const view = chainView(document.createElement("canvas"), joints, [1, 0, 0], () => {});
        return [view.flat, view.azimuth, view.elevation];
    }""")
    assert seen == [True, pytest.approx(-np.pi / 2), 0.0]

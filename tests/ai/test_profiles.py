"""What each profile may ask, and the limits of the one that acts."""

from typing import Any, cast

import pytest

from dtwin.ai.profiles import PROFILES, RIGHTS, Allowance, Doors, Limits, Profile, Rate, role_of
from dtwin.bus.messages import TOPICS
from dtwin.bus.session import Bus
from dtwin.errors import ParameterError
from dtwin.parameters import Gains
from tests.services.test_rights import GRANTED


class Silent(Bus):
    """A bus that must not be asked."""

    def __init__(self) -> None:
        self.asked = False

    def ask(self, *_: Any, **__: Any) -> Any:
        self.asked = True
        raise AssertionError


@pytest.mark.parametrize("profile", PROFILES)
def test_the_program_asks_what_the_router_grants_and_no_more(profile: Profile) -> None:
    granted = {right.topic for right in GRANTED if (right.role, right.action) == (f"ai-{profile}", "ask")}
    assert granted == {topic.name for topic in RIGHTS[profile]}


def test_nothing_that_observes_or_proposes_may_act() -> None:
    acting = {"controller/stop", "controller/release", "controller/settings", "controller/desk", "emulator/fault"}
    acting |= {"twin/simulation/upload", "twin/simulation/decide", "twin/monitoring/acknowledge"}
    quiet: tuple[Profile, ...] = ("observe", "propose")
    for profile in quiet:
        assert not acting & {topic.name for topic in RIGHTS[profile]}
    assert "twin/simulation/decide" not in {topic.name for topic in RIGHTS["act"]}


@pytest.mark.parametrize("profile", PROFILES)
def test_a_door_that_is_not_the_profiles_own_stays_shut(profile: Profile) -> None:
    bus, message = Silent(), cast(Any, Gains)
    for topic in TOPICS:
        if topic not in RIGHTS[profile]:
            with pytest.raises(ParameterError, match="may not ask this"):
                Doors(bus, profile).ask(topic, None, message)
    assert not bus.asked
    assert role_of(profile) == f"ai-{profile}"


def test_changes_are_counted_against_their_limits() -> None:
    now = [0.0]
    allowance = Allowance(Limits(hourly=2, pause=5.0), lambda: now[0])
    allowance.count()
    with pytest.raises(ParameterError, match="5 s between two changes"):
        allowance.count()
    now[0] = 5.0
    allowance.count()
    now[0] = 3599.0
    with pytest.raises(ParameterError, match="at most 2 changes an hour"):
        allowance.count()
    now[0] = 3600.0
    allowance.count()


def test_a_step_is_no_larger_than_its_limit() -> None:
    allowance = Allowance(Limits(factor=2.0), lambda: 0.0)
    allowance.check_step("target_time", 2.0, 4.0)
    allowance.check_step("target_time", 2.0, 1.0)
    for value in (4.01, 0.99, 0.0):
        with pytest.raises(ParameterError, match="target_time: limit"):
            allowance.check_step("target_time", 2.0, value)
    gains = Gains((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    allowance.check_gains(gains, gains)
    with pytest.raises(ParameterError, match="ki: limit"):
        allowance.check_gains(gains, Gains(gains.kp, (0.0, 1.0, 0.0), gains.kd))


def test_calls_are_bounded() -> None:
    now = [0.0]
    rate = Rate(3, lambda: now[0])
    for _ in range(3):
        rate.count()
    with pytest.raises(ParameterError, match="at most 3 a second"):
        rate.count()
    now[0] = 1.0
    rate.count()


@pytest.mark.parametrize(("hourly", "pause", "factor"), [(0, 5.0, 2.0), (1, -1.0, 2.0), (1, 5.0, 0.5)])
def test_limits_that_are_none_are_refused(hourly: int, pause: float, factor: float) -> None:
    with pytest.raises(ParameterError, match="limits: expected"):
        Limits(hourly, pause, factor)

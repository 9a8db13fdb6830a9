"""A monitor that is behind the arm says so once."""

from dtwin.services.parts.watching.behind import Behind


def test_a_monitor_that_falls_behind_says_so_once_and_once_when_it_has_caught_up() -> None:
    behind = Behind()
    behind.came(10.0)
    assert not behind.looked(9.99)
    assert not behind.looked(9.0), "a verdict counts for a second"
    behind.came(12.5)
    assert behind.looked(9.01).startswith("the monitor is 3.5 s behind the arm")
    assert not behind.looked(11.9), "it has still to catch up"
    assert behind.looked(12.45) == "the monitor is no longer behind the arm"
    assert not behind.looked(12.5)


def test_another_run_whose_times_begin_anew_is_not_ahead() -> None:
    behind = Behind()
    behind.came(100.0)
    behind.came(0.01)
    assert not behind.looked(0.01)

"""The last samples: columns hold what a queue of samples would hold."""

from __future__ import annotations

from collections import deque

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dtwin.monitoring.tracking.moments import Moment, Moments

MOST = 7
steps = st.lists(st.integers(-2, MOST), max_size=30)
"""Numbers of samples that come at once; one alone for -1, and none are kept for -2."""


def moment(number: int) -> Moment:
    angles = np.full(3, float(number))
    used, fresh = angles > 3.0, angles < 5.0
    return Moment(angles + 0.1, number % 2 == 0, number + 0.2, angles, used, fresh, number % 3 == 0, -number - 0.3)


def plain(moments: list[Moment]) -> list[list[object]]:
    return [[np.asarray(value).tolist() for value in each] for each in moments]


@given(steps)
def test_the_last_samples_are_kept(counts: list[int]) -> None:
    moments, queue, number = Moments(MOST), deque[Moment](maxlen=MOST), 0
    for count in counts:
        come = [moment(number + k) for k in range(MOST if count >= 0 else 1)]
        if count >= 0:
            moments.extend(tuple(map(np.array, zip(*come, strict=True))), count)
        elif count == -1:
            moments.append(come[0])
        else:
            moments.clear()
            queue.clear()
        queue.extend(come[: max(count, 0) if count != -1 else 1])
        number += MOST
        assert plain(moments.last(len(moments))) == plain(list(queue))


def test_the_last_one_can_be_replaced_and_all_of_them() -> None:
    moments = Moments(MOST)
    moments.append(moment(1))
    (kept,) = moments.last(1)
    moments.replace_last(moment(2))
    assert plain([kept, *moments.last(1)]) == plain([moment(1), moment(2)])
    moments.replace([moment(4), moment(5)])
    assert plain(moments.last(2)) == plain([moment(4), moment(5)])
    assert len(moments) == 2

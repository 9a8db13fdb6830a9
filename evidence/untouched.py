"""Which drawn machines were looked at while methods were made, and count for nothing in what these are judged by."""

from __future__ import annotations

from typing import Final

from dtwin.errors import ParameterError

TUNED: Final = (
    *(*range(501, 507), *range(620, 626), 815, *range(961, 968), 1023, 1061, 1062),
    *(*range(1101, 1105), *range(1121, 1127), 1147, *range(1161, 1167), 1203, 1207, 1208, 1214, 1218),
    *(*range(1251, 1259), *range(1310, 1314), 1327, *range(1331, 1334), 1346, *range(1350, 1353), 1359, 1361),
    *(1364, 1368, 1371, 1377, 1378, *range(1384, 1387), 1389, *range(1393, 1396), 1403, 1407, 1408, 1412),
    *(1413, 1415, 1416, *range(1418, 1421)),
    *(*range(1421, 1427), 1436, 1437, 1450, *range(1451, 1457), 1468, 1476, 1477, 1480),
    *(1481, 1484, 1485, 1492, 1511),
    *(1561, 1562, 1582, 1623, 1673, 1682, 1685, 1713, 1729, 1731, 1803),
    *(3001, 3002, 3003, 4002, 5004, 5006, 62101, 62102, *range(72001, 72007), *range(72101, 72121), 905511),
    *(*range(94001, 94009), *range(98001, 98009)),
    *(*range(91901, 91907), *range(92101, 92125), *range(92301, 92321), *range(93001, 93011)),
    *(9401, 9402, 880000, 880001, 880200, *range(880410, 880415), *range(880420, 880425), 880500, 880501),
    *(880440, 880441, *range(881000, 881004), *range(882000, 882003), *range(884000, 884003)),
)
"""Numbers of the machines that identification, monitoring and recovery were tuned on, or mended after a look at."""


def untouched(first: int, count: int) -> range:
    """The consecutive numbers of machines that nobody tuned to.

    Raises:
        ParameterError: somebody tuned to one of them.
    """
    numbers = range(first, first + count)
    if tuned := [number for number in TUNED if number in numbers]:
        raise ParameterError(f"--first {first}: expected machines that nobody tuned to, got {tuned[0]}")
    return numbers

"""Tests of function blocks: blocks and whole systems on a bench, in simulated time.

    from iec61499.testing import block

    def test_it_counts() -> None:
        counter = block("COUNTER", PV=2)
        counter.CU(R=False)
        assert counter.CV == 1
        assert counter.events == ("CUO",)

`fb test` and pytest find these tests, the service sequences of block types, and programs that are tests.
"""

from iec61499.testing.bench import Bench as Bench
from iec61499.testing.bench import block as block
from iec61499.testing.systems import SystemBench as SystemBench
from iec61499.testing.systems import system as system

__all__ = ["Bench", "SystemBench", "block", "system"]

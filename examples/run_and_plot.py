# %% [markdown]
# # Run the cell and look at it
# Boxes come at random, two or three in 30 s. The arm is made heavier than its controller believes.

# %%
import sys
from pathlib import Path

import dtwin

seconds = float(sys.argv[1]) if len(sys.argv) == 3 else 30.0
folder = Path(sys.argv[2]) if len(sys.argv) == 3 else Path(".")

# %%
run = dtwin.Cell(seed=1, noise=0.001, set={"m3": 0.16}).run(seconds)
print(run.score.boxes)
print("largest distance from the path, rad:", run.score.tracking_error_rad.max)

# %% [markdown]
# Every column is an array; `run.frame()` gives a data frame where pandas or polars is installed.

# %%
volts = run.log.stack("volts")[:, :3]
print("largest voltages, V:", abs(volts).max(axis=0))
for event in run.events:
    print(f"{event.time:6.2f} s  {event.kind}  {event.text}")

# %% [markdown]
# A picture here, a recording for the Rerun viewer, and the log, which `dtwin.load` reads again.

# %%
picture = run.plot()
picture.savefig(folder / "run.png")
run.record(folder / "run.rrd")
run.save(folder / "run.parquet")
assert dtwin.load(folder / "run.parquet").events == run.events
picture  # noqa: B018 (shown by a notebook)

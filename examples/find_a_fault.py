# %% [markdown]
# # Inject a fault, monitor, and show what was found
# Motor 1 loses 20 % of its torque in the middle of the run. The monitor sees what encoders and commands say, no more.

# %%
import sys
from pathlib import Path

import dtwin

seconds = float(sys.argv[1]) if len(sys.argv) == 3 else 40.0
folder = Path(sys.argv[2]) if len(sys.argv) == 3 else Path(".")

# %%
run = dtwin.Cell(seed=3, noise=0.003, fault=f"K1*=0.8@{seconds / 2}").run(seconds)
watched = dtwin.monitor(run)

# %%
print(watched.states)
for finding in watched.history:
    print(finding.text())
print(f"detected {watched.history[0].detected - seconds / 2:.2f} s after it began")

# %% [markdown]
# What would other settings do on such an arm?

# %%
weak = {"K1": 0.8 * dtwin.ArmParameters().get("K1")}
for time in (2.0, 3.0):
    motion = dtwin.simulate("pickup", "green", target_time=time, set=weak)
    print(f"{time:g} s a motion: {1e3 * max(motion.figures.tracking_max):.1f} mrad from the path at most")

# %%
picture = watched.plot()
picture.savefig(folder / "finding.png")
watched.record(folder / "finding.rrd")
picture  # noqa: B018 (shown by a notebook)

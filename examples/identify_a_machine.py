# %% [markdown]
# # Identify a machine and compare it with its data sheet
# The machine has a motor that is weaker than its data sheet says: `dtwin machine list` tells of others.

# %%
import sys
from pathlib import Path

import dtwin

seconds = float(sys.argv[1]) if len(sys.argv) == 3 else 40.0
folder = Path(sys.argv[2]) if len(sys.argv) == 3 else Path(".")

# %%
work = dtwin.Cell(machine="weak-motor", seed=2, noise=0.001, noise_kind="gaussian").run(seconds)

# %% [markdown]
# Motions of the empty arm say nothing of the scale of the forces, so motor 1 keeps the constant of the data sheet.

# %%
found = dtwin.identify(work, free="K2,K3,c,D")
sheet = dtwin.ArmParameters()
print(f"{'':4}{'identified':>12}{'+- 95 %':>10}{'data sheet':>12}{'difference':>12}")
for name, value in found.values.items():
    stated = sheet.get(name)
    print(f"{name:4}{value:12.5f}{found.intervals[name]:10.5f}{stated:12.5f}{100 * (value / stated - 1):11.2f} %")

# %% [markdown]
# The identification says itself how far it is to be trusted. Where the last fifth of a run is rest, the fit is low:
# there is nothing but noise to predict.

# %%
print("fit on motion that was kept back:", found.held_out.fit)
print("doubts:", found.doubts or "none")

# %%
picture = found.plot()
picture.savefig(folder / "identified.png")
found.save(folder / "arm.json")
picture  # noqa: B018 (shown by a notebook)

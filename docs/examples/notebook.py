"""A lab from Python: simulates it, prints a table of its robots, draws their ways.

Run it as a script, or open it as a notebook (VS Code, PyCharm, or Jupyter with jupytext):
`python docs/examples/notebook.py [LAB [PICTURE.png]]`.
"""

# %%
import sys
from pathlib import Path

import rmr

LABS = Path(__file__).parents[2] / "deploy" / "labs" if "__file__" in globals() else Path("deploy/labs")
script = Path(sys.argv[0]).name == "notebook.py"
lab = Path(sys.argv[1]) if script and len(sys.argv) > 1 else LABS / "corridor"
picture = Path(sys.argv[2]) if script and len(sys.argv) > 2 else None

# %% [markdown]
# One run. The same seed gives the same run, on every machine.

# %%
run = rmr.simulate(lab, seed=7)
print(f"{run.lab}: finished {run.finished}, {run.time_s:.1f} s, {run.report['collisions']} contacts")

# %% [markdown]
# The report is plain data.

# %%
print(f"{'robot':>5} {'finish':>8} {'way':>7} {'actions':>8}")
for robot, entry in run.report["robots"].items():
    finish = "-" if entry["finish_s"] is None else f"{entry['finish_s']:.1f} s"
    print(f"{robot:>5} {finish:>8} {entry['distance_m']:5.2f} m {len(entry['actions']):>8}")

# %% [markdown]
# The ways of the robots are arrays with the columns time, x, y, heading.

# %%
try:
    import matplotlib.pyplot as plt
except ImportError:
    print("no picture: matplotlib is not installed")
else:
    figure, axes = plt.subplots()
    for robot, way in run.trajectories.items():
        axes.plot(way[:, 1], way[:, 2], label=f"robot {robot}")
        axes.plot(*way[0, 1:3], "o", color=axes.lines[-1].get_color())
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title=f"{run.lab}, seed {run.seed}")
    axes.legend()
    if picture is None:
        plt.show()
    else:
        figure.savefig(picture)
        print(f"the picture is {picture}")

# %% [markdown]
# Ten seeds with a tenth of all radio frames lost.

# %%
times = [rmr.simulate(lab, seed=seed, loss=0.1, rate=1.0).time_s for seed in range(10)]
print(f"with 10 % loss: {min(times):.1f} to {max(times):.1f} s")

r"""
Smoothing and decision
======================

Spread the votes to pixels without texture, then find where they change from "in front" to "behind".
"""

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes
from lfdepth.blocks.decode import accumulate, sign_step

lf = scenes.render("demo", size=160, views=9)
trace = lfdepth.Trace(keep=("votes", "smoothed"))
result = lfdepth.estimate(lf, "fbs-sfa", step=0.1, trace=trace)
planes = result.method.planes_for(result.range)
votes, smoothed = (np.array(trace.kept[name]) for name in ("votes", "smoothed"))

# %%
# The guided filter
# -----------------
#
# Smooth areas have no derivatives, hence no votes. A guided filter spreads the votes of their surroundings, and stops at
# edges of the reference view, its guide. lfdepth smooths the sum of the votes and their number separately and then
# divides, so that pixels without evidence do not pull their neighbours towards zero. *r* is the window's radius, ε
# says how weak an edge may be to stop the filter.

k = int(np.argmin(abs(planes)))
figure, axes = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained")
axes[0].imshow(lf.reference)
axes[0].set_title("reference view (the guide)")
axes[1].imshow(votes[k], cmap="RdBu_r", vmin=-1, vmax=1)
axes[1].set_title(f"votes at D = {planes[k]:.1f}")
axes[2].imshow(smoothed[k], cmap="RdBu_r", vmin=-1, vmax=1)
axes[2].set_title("smoothed")
for axis in axes:
    axis.set_axis_off()

# %%
# The volume
# ----------
#
# All planes together make a volume. The slice along one row shows what foreground-background separation means: blue is
# behind, red in front, and the surface is the boundary between the two.

row = 80
figure, axis = plt.subplots(figsize=(10, 3), layout="constrained")
axis.imshow(
    smoothed[:, row],
    cmap="RdBu_r",
    vmin=-1,
    vmax=1,
    aspect="auto",
    extent=(0, 160, planes[-1], planes[0]),
)
axis.plot(np.arange(160) + 0.5, lf.truth[row], "k--", linewidth=1, label="truth")
axis.plot(
    np.arange(160) + 0.5, result.disparity[row], "g", linewidth=1, label="fbs-sfa"
)
axis.set(xlabel=f"x in row {row} (px)", ylabel="D (px per view step)")
axis.legend(loc="lower right")

# %%
# Two ways to find the boundary
# -----------------------------
#
# ``fbs`` *accumulates*: the sum of all decisions along the planes, times the step, is the disparity. One wrong plane
# shifts the result. ``fbs-sfa`` *approximates the sign function*: it places one step from +1 to -1 so that it fits the
# whole profile best, which a few wrong planes cannot move far.

y, x = row, 60
fitted = sign_step(smoothed, planes)
accumulated = accumulate(smoothed, planes)
figure, axis = plt.subplots(figsize=(7, 3), layout="constrained")
axis.plot(planes, smoothed[:, y, x], marker=".", label="smoothed votes")
axis.step(
    planes,
    np.where(planes < fitted[y, x], 1, -1),
    where="mid",
    label="best fitting step",
)
axis.axvline(lf.truth[y, x], color="black", linestyle="--", label="truth")
axis.set(xlabel="D (px per view step)", ylabel="votes", title=f"pixel ({x}, {y})")
axis.legend()

# %%

figure, axes = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained")
pictures = {
    "truth": lf.truth,
    "accumulation (fbs)": accumulated,
    "sign function (fbs-sfa)": fitted,
}
for axis, (title, values) in zip(axes, pictures.items(), strict=True):
    axis.imshow(values, vmin=result.range[0], vmax=result.range[1])
    axis.set_title(title)
    axis.set_axis_off()

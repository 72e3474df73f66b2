"""
Confidence, and what to drop
============================

How sure is each pixel, and how much better does the map get without the doubtful ones?
"""

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes

lf = scenes.render("room", size=192, views=7)
result = lfdepth.estimate(lf)
error = np.abs(result.disparity - lf.truth)

# %%
# ``confidence`` lies between 0 and 1 and is low where the views hold no evidence: in areas without texture and beside
# depth edges. ``sigma`` is a standard error in px per view step, for pixels that are not wrong altogether.

figure, axes = plt.subplots(1, 4, figsize=(13, 3.4), layout="constrained")
axes[0].imshow(lf.reference)
axes[0].set_title("reference view")
for axis, (title, values, most) in zip(
    axes[1:],
    (
        ("absolute error", error, 0.2),
        ("confidence", result.confidence, 1),
        ("sigma", result.sigma, 0.05),
    ),
    strict=True,
):
    picture = axis.imshow(values, vmin=0, vmax=most, cmap="magma")
    axis.set_title(title)
    figure.colorbar(picture, ax=axis, shrink=0.8)
for axis in axes:
    axis.set_axis_off()

# %%
# Drop the least confident pixels first, and see how many of the remaining ones are wrong by more than 0.07 px. The
# dashed line is the best any confidence could do: it knows the error.

dropped = np.linspace(0, 0.6, 31)


def bad_after_dropping(order):
    """Share of bad pixels among those that are left, in %."""
    sorted_bad = (error.ravel() > 0.07)[np.argsort(order.ravel())]
    return [100 * sorted_bad[int(share * error.size) :].mean() for share in dropped]


figure, axis = plt.subplots(figsize=(6, 3.6), layout="constrained")
axis.plot(100 * dropped, bad_after_dropping(result.confidence), label="by confidence")
axis.plot(100 * dropped, bad_after_dropping(-error), "--", label="by the true error")
axis.set(
    xlabel="pixels dropped (%)", ylabel="BadPix 0.07 of the rest (%)", ylim=(0, None)
)
axis.legend()

# %%
# In practice: mask the map before you use it.

usable = np.where(result.confidence > 0.3, result.disparity, np.nan)
print(f"kept {np.isfinite(usable).mean():.0%} of the pixels")
print(f"BadPix 0.07 of all pixels  {100 * (error > 0.07).mean():.1f} %")
print(
    f"BadPix 0.07 of those kept  {100 * (error[np.isfinite(usable)] > 0.07).mean():.1f} %"
)

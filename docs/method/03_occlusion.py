r"""
Occlusion: excluding the foreground
===================================

Beside an occluder, the views that see it vote wrongly. Mask them with what was already found in front.
"""

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes
from lfdepth.blocks.occlusion import mask_4d
from lfdepth.blocks.voting import Mask, vote

lf = scenes.render("bars", size=160, views=9)

# %%
# The problem
# -----------
#
# A bar at a disparity of 1.7 hides different parts of the wall in different views. On a plane just in front of the wall,
# the views that see the bar there vote "in front", although the pixel shows the wall: the foreground gets fatter.

plane = -0.9
plain = vote(lf, plane)
figure, axes = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained")
axes[0].imshow(lf.reference)
axes[0].set_title("reference view")
axes[1].imshow(np.where(lf.truth > plane, 1, -1), cmap="RdBu_r", vmin=-1, vmax=1)
axes[1].set_title(f"truth: in front of D = {plane}?")
axes[2].imshow(plain, cmap="RdBu_r", vmin=-1, vmax=1)
axes[2].set_title("votes of all views")
for axis in axes:
    axis.set_axis_off()

# %%
# The 4-D mask (equation 7)
# -------------------------
#
# The sweep runs front to back, so the bars have been found before it comes to the wall. Their map *BW* is carried
# to every view: ``F(x, y, u, v) = BW(x − Δ·u, y − Δ·v)``, with Δ the distance between the
# plane at hand and the one where they were found. Here the truth stands in for the map, and all of it is carried from
# *D* = 1.

foreground = lf.truth > 0
mask = mask_4d(foreground, found_at=1.0, wanted_at=plane, views=(9, 9))
figure, axes = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained")
for axis, (v, u) in zip(axes, ((4, 4), (0, 0), (8, 4)), strict=True):
    axis.imshow(mask[v, u], cmap="gray")
    axis.set_title(f"mask of view ({v}, {u}) at D = {plane}")
    axis.set_axis_off()

# %%
# Votes with the mask (algorithms 1 and 2)
# ----------------------------------------
#
# Pixels inside the mask are voted on by the views that see foreground, all others by the views that do not.
# ``fbsocc-sfa`` does this for every plane *k* with the foreground found *J* planes in front, and so
# excludes one foreground after the other.

masked = vote(lf, plane, mask=Mask(foreground, plane - 1.0))
figure, axes = plt.subplots(1, 2, figsize=(8, 4.3), layout="constrained")
for axis, (title, values) in zip(
    axes, {"all views": plain, "with the mask": masked}.items(), strict=True
):
    wrong = (values > 0) != (lf.truth > plane)
    axis.imshow(np.where(wrong & (values != 0), 1, 0), cmap="Reds", vmax=1.5)
    axis.set_title(
        f"wrong votes, {title}: {100 * (wrong & (values != 0)).mean():.1f} %"
    )
    axis.set_axis_off()

# %%
# The maps
# --------
#
# The paper's mask carries each foreground as one plane, *J* planes behind the plane where it was found. The default
# method, ``fbs-vis``, carries every pixel at its own disparity instead; :doc:`/fbs-vis` explains how.

names = ("fbs-sfa", "fbsocc-sfa", "fbs-vis")
figure, axes = plt.subplots(1, 4, figsize=(13, 3.8), layout="constrained")
axes[0].imshow(lf.truth)
axes[0].set_title("truth")
for axis, name in zip(axes[1:], names, strict=True):
    result = lfdepth.estimate(lf, name)
    axis.imshow(result.disparity, vmin=lf.truth.min(), vmax=lf.truth.max())
    axis.set_title(
        f"{name}: BadPix 0.07 {lfdepth.evaluate(result, lf)['badpix_0.07']:.1f} %"
    )
for axis in axes:
    axis.set_axis_off()

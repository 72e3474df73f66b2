r"""
Planes, signs and votes
=======================

On which side of a plane does a surface lie? Every pixel of every view votes.
"""

import matplotlib.pyplot as plt
import numpy as np

from lfdepth import scenes
from lfdepth.blocks.planes import disparity_planes
from lfdepth.blocks.reparam import reparameterise
from lfdepth.blocks.voting import VoteRule, disparity_signs, vote

lf = scenes.render("demo", size=160, views=9)
grey = lf.grey()

# %%
# Reparameterisation (equation 1)
# -------------------------------
#
# The methods sweep planes of disparity *D* from front to back. For every plane the views are shifted by
# *D* times their place in the grid, ``L_D(x, y, u, v) = L(x − D·u, y − D·v, u, v)``, so that whatever lies on the
# plane falls into register. The pictures are slices of the views: one row of pixels, stacked over the nine views
# of the middle row of the grid (an epipolar plane image, EPI). A surface on the plane stands upright, a nearer one
# leans one way and a farther one the other.

row = 80
figure, axes = plt.subplots(4, 1, figsize=(9, 4.6), layout="constrained")
axes[0].imshow(lf.reference[row - 6 : row + 7], aspect="auto")
axes[0].axhline(6, color="red", linewidth=1)
axes[0].set_title(
    "13 rows of the reference view; the red one is shown below", fontsize=9
)
for axis, disparity in zip(axes[1:], (1.0, 0.0, -1.0), strict=True):
    shifted = reparameterise(grey, disparity)
    axis.imshow(shifted[4, :, row], cmap="gray", aspect="auto", interpolation="nearest")
    axis.set_title(f"EPI at D = {disparity:g}", fontsize=9)
for axis in axes:
    axis.set_axis_off()

# %%
# Disparity signs (equations 2 and 3)
# -----------------------------------
#
# Which way a line leans is the sign of the product of two derivatives, along the picture and across the views:
# ``S_xu = sgn(∂x L_D · ∂u L_D)``, and ``S_yv = sgn(∂y L_D · ∂v L_D)`` along columns. It
# is +1 where the surface is in front of the plane and −1 where it is behind. No depth is needed, and the size of the
# derivatives does not matter.

along_x, along_y = disparity_signs(lf, 0.0)
figure, axes = plt.subplots(1, 4, figsize=(13, 3.8), layout="constrained")
axes[0].imshow(lf.reference)
axes[0].set_title("reference view")
axes[1].imshow(along_x[4, 4], cmap="RdBu_r", vmin=-1, vmax=1)
axes[1].set_title("$S_{xu}$ of the reference view, D = 0")
axes[2].imshow(along_y[4, 4], cmap="RdBu_r", vmin=-1, vmax=1)
axes[2].set_title("$S_{yv}$ of the reference view, D = 0")
axes[3].imshow(np.where(lf.truth > 0, 1, -1), cmap="RdBu_r", vmin=-1, vmax=1)
axes[3].set_title("truth: in front of D = 0?")
for axis in axes:
    axis.set_axis_off()

# %%
# The vote (equations 4 to 6)
# ---------------------------
#
# One view is noisy, but there are 81. Their signs are added up and divided by the number of votes. A vote counts only
# where it can be trusted: with ``delta="photo"``, δ is 1 where the view's grey level is within τ
# of the reference view's, that is where the view seems to show the same thing. The pictures show the votes
# *C* on three planes: red pixels lie in front of the plane, blue ones behind it, white ones have no evidence.

planes = disparity_planes((-1.6, 1.6), step=0.8)
figure, axes = plt.subplots(1, 4, figsize=(13, 3.8), layout="constrained")
for axis, plane in zip(axes, planes[1:], strict=True):
    axis.imshow(
        vote(lf, plane, rule=VoteRule(delta="photo", threshold=0.03)),
        cmap="RdBu_r",
        vmin=-1,
        vmax=1,
    )
    axis.set_title(f"votes at D = {plane:.1f}")
    axis.set_axis_off()

"""
Explain a pixel
===============

Why did this pixel get its disparity? Look at the evidence along all planes.
"""

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes

lf = scenes.render("wedges", size=160, views=9)
result = lfdepth.estimate(lf)

# %%
# The pixel lies on the far wall beside a wedge, where many views see the wedge instead of the wall. Of all such pixels
# that the method gets right, it is the one that is most wrong if all views count alike.

alike = lfdepth.estimate(lf, visibility=False)
right = (lf.truth < -1) & (abs(result.disparity - lf.truth) < 0.05)
right[:20], right[-20:], right[:, :20], right[:, -20:] = (False,) * 4
gained = np.where(right, abs(alike.disparity - lf.truth), 0)
y, x = (int(place) for place in np.unravel_index(np.argmax(gained), right.shape))
print(f"pixel ({x}, {y}), in px per view step:")
print(f"  truth {lf.truth[y, x]:.2f}, estimate {result.disparity[y, x]:.2f}")
print(f"  estimate with all views alike {alike.disparity[y, x]:.2f}")

# %%
# ``explain`` collects the evidence of one pixel, and says in a sentence which block decided it.

evidence = lfdepth.explain(lf, result, x=x, y=y)
print(evidence.decision)
for stage in evidence.stages:
    print(f"  {stage.name:28}{stage.disparity:6.2f} px per view step")

# %%
# Three profiles along the planes. *Sign votes* change from "in front" to "behind" where the surface is. *Photo votes* are
# the share of views that show the reference view's colour, at first among all views, then among those that see the
# pixel. The *energy* joins both. Here it is least at the wedges' disparity, and only the decision on depth edges, which
# asks whose colour the pixel has, puts it on the wall.

planes = evidence.planes
figure, axes = plt.subplots(3, 1, figsize=(7, 6.4), sharex=True, layout="constrained")
axes[0].plot(planes, evidence.signs)
axes[0].axhline(0, color="grey", linewidth=0.8)
axes[0].set_ylabel("sign votes")
axes[1].plot(planes, evidence.photo, label="all views")
axes[1].plot(planes, evidence.photo_visible, label="views that see the pixel")
axes[1].set_ylabel("photo votes")
axes[1].legend()
axes[2].plot(planes, evidence.energy)
axes[2].set(ylabel="energy", xlabel="disparity (px per view step)")
for axis in axes:
    axis.axvline(lf.truth[y, x], color="green", linestyle="--", label="truth")
    axis.axvline(evidence.disparity, color="red", linestyle=":", label="estimate")
axes[0].legend()

# %%
# The angular patch is what each view shows at the place where the pixel should be, if its disparity is right: the wall
# where a view sees past the wedges, and a wedge where it does not. ``states`` says which views are hidden; they are
# crossed out. Beside it the epipolar plane image, with the line that the pixel draws.

figure, (left, middle, below) = plt.subplots(
    1, 3, figsize=(12, 4.2), layout="constrained"
)
left.imshow(lf.reference)
left.plot(x, y, "r+", markersize=14, markeredgewidth=2)
left.set_title("reference view")
left.set_axis_off()
middle.imshow(evidence.colours)
hidden = np.argwhere(evidence.states != evidence.states[lf.centre])
middle.plot(hidden[:, 1], hidden[:, 0], "kx")
middle.set(title="angular patch", xlabel="u", ylabel="v", xticks=[], yticks=[])
start = evidence.epi_start[1]
epi = evidence.epi_vertical
below.imshow(
    epi, aspect="auto", extent=(start - 0.5, start + epi.shape[1] - 0.5, 4.5, -4.5)
)
views = np.arange(-4, 5)
below.plot(y - evidence.disparity * views, views, "r")
below.set(title="epipolar plane image of the column", xlabel="y (px)", ylabel="v")

# %%
# In the browser, ``lfdepth view`` shows the same for every pixel that is clicked: :doc:`/viewer`.

"""
Explain a pixel
===============

Why did this pixel get its disparity? Look at the evidence along all planes.
"""

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes

# %%
# A ``Trace`` keeps intermediate arrays of a run by name. ``fbs-vis`` offers its smoothed sign votes, the shares of views
# that agree in colour, and its energies. The second entry of a list is from the second pass, when it is known which
# views see each pixel.

lf = scenes.render("wedges", size=160, views=9)
trace = lfdepth.Trace(keep=("smoothed", "shares", "joint energies"))
result = lfdepth.estimate(lf, trace=trace)
planes = result.method.planes_for(result.range)

# %%
# The pixel lies on the far wall beside a wedge, where many views see the wedge instead of the wall. Of all such pixels
# that the method gets right, it is the one that is most wrong if all views count alike.

alike = lfdepth.estimate(lf, visibility=False)
right = (lf.truth < -1) & (abs(result.disparity - lf.truth) < 0.05)
right[:20], right[-20:], right[:, :20], right[:, -20:] = (False,) * 4
y, x = np.unravel_index(
    np.argmax(np.where(right, abs(alike.disparity - lf.truth), 0)), right.shape
)
print(f"with all views alike {alike.disparity[y, x]:.2f} px per view step")
print(
    f"pixel ({x}, {y}): estimate {result.disparity[y, x]:.2f}, truth {lf.truth[y, x]:.2f} px per view step"
)

# %%
# Three profiles along the planes, from far to near. *Sign votes* change from "in front" to "behind" where the surface
# is. *Photo votes* are the share of views that show the reference view's colour, at first among all views, then among
# those that see the pixel. The *energy* joins both. The pixel's own energy is least at the wedges' disparity; the wall's
# is the second best, and the neighbours along the scanlines decide for it.

figure, axes = plt.subplots(3, 1, figsize=(7, 6.4), sharex=True, layout="constrained")
axes[0].plot(planes, [votes[y, x] for votes in trace.kept["smoothed"]])
axes[0].axhline(0, color="grey", linewidth=0.8)
axes[0].set_ylabel("sign votes")
first, second = (shares[:, y, x] for shares in trace.kept["shares"][:2])
axes[1].plot(np.linspace(planes[0], planes[-1], len(first)), first, label="all views")
axes[1].plot(
    np.linspace(planes[0], planes[-1], len(second)),
    second,
    label="views that see the pixel",
)
axes[1].set_ylabel("photo votes")
axes[1].legend()
energy = trace.kept["joint energies"][-1][:, y, x]
axes[2].plot(np.linspace(planes[0], planes[-1], len(energy)), energy)
axes[2].set(ylabel="energy", xlabel="disparity (px per view step)")
for axis in axes:
    axis.axvline(lf.truth[y, x], color="green", linestyle="--", label="truth")
    axis.axvline(result.disparity[y, x], color="red", linestyle=":", label="estimate")
axes[0].legend()

# %%
# The angular patch: what each view shows at the place where the pixel should be, if its disparity is right. The colour
# of the wall appears where a view sees past the wedges, the wedges' colour where it does not.

v, u = np.indices((9, 9)) - 4
rows = np.clip(np.rint(y - v * result.disparity[y, x]).astype(int), 0, lf.height - 1)
columns = np.clip(np.rint(x - u * result.disparity[y, x]).astype(int), 0, lf.width - 1)
patch = lf.views[np.arange(9)[:, None], np.arange(9), rows, columns]
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 4.3), layout="constrained")
left.imshow(lf.reference)
left.plot(x, y, "r+", markersize=14, markeredgewidth=2)
left.set_title("reference view")
left.set_axis_off()
right.imshow(patch)
right.set(title="angular patch", xlabel="u", ylabel="v", xticks=[], yticks=[])

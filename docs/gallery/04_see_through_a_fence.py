"""
See through a fence
===================

A fence hides different parts of the scene in different views. Average only the views that see past it.
"""

import matplotlib.pyplot as plt

import lfdepth
from lfdepth import scenes

lf = scenes.render("fence", size=160, views=9)
result = lfdepth.estimate(lf)

# %%
# The fence is at a disparity of more than 1, everything else is below 0.5. Focusing on the wall blurs the fence but does
# not remove it: it is averaged in. With ``without_foreground=0.5`` every pixel is the mean of those views only in which
# nothing nearer than 0.5 covers it. The disparity map says which ones these are.

wall = lfdepth.refocus(lf, -1.4)
through = lfdepth.refocus(lf, -1.4, without_foreground=0.5, disparity_map=result)

figure, axes = plt.subplots(1, 4, figsize=(13, 3.8), layout="constrained")
pictures = {
    "reference view": lf.reference,
    "disparity": result.disparity,
    "focused on the wall": wall,
    "without the fence": through,
}
for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
    axis.imshow(picture)
    axis.set_title(title)
    axis.set_axis_off()

# %%
# ``foreground_masks`` gives the same information for every view: where it shows the fence. Here are the masks of the
# top left view, the reference view and the bottom right view.

masks = lfdepth.foreground_masks(lf, result, 0.5)
figure, axes = plt.subplots(1, 3, figsize=(10, 3.8), layout="constrained")
for axis, (v, u) in zip(axes, ((0, 0), (4, 4), (8, 8)), strict=True):
    axis.imshow(masks[v, u], cmap="gray")
    axis.set_title(f"mask of view ({v}, {u})")
    axis.set_axis_off()

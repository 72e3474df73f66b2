"""
A first disparity map
=====================

Render a light field with exact truth, estimate its disparity, and look at the error.
"""

import matplotlib.pyplot as plt

import lfdepth
from lfdepth import scenes

# %%
# A light field is a grid of views of one scene. This one is rendered, 7×7 views of 192×192 px, so that its exact
# disparity is known. Yours comes from ``lfdepth.read("path/to/folder")``.

lf = scenes.render("demo", size=192, views=7)
print(lf.shape)  # rows of views, columns of views, height, width, colour channels

# %%
# One call estimates the disparity of the reference view, the one in the middle. Disparity is in pixels per view step:
# how far a point moves from one view to the next. Larger means nearer.

result = lfdepth.estimate(lf)
print(
    f"{result.planes} planes between {result.range[0]:g} and {result.range[1]:g} px per view step"
)

# %%
# Because the truth is known, the map can be scored. BadPix 0.07 is the percentage of pixels that are wrong by more than
# 0.07 px per view step.

scores = lfdepth.evaluate(result, lf)
print(f"BadPix 0.07: {scores['badpix_0.07']:.2f} %,  MSE×100: {scores['mse_x100']:.2f}")

# %%
# Red in the error picture is too near, blue is too far.

low, high = result.range
figure, axes = plt.subplots(1, 4, figsize=(12, 3.4), layout="constrained")
axes[0].imshow(lf.reference)
axes[0].set_title("reference view")
axes[1].imshow(lf.truth, vmin=low, vmax=high)
axes[1].set_title("truth")
picture = axes[2].imshow(result.disparity, vmin=low, vmax=high)
axes[2].set_title("estimate")
figure.colorbar(picture, ax=axes[:3], label="disparity (px per view step)", shrink=0.9)
error = axes[3].imshow(result.disparity - lf.truth, vmin=-0.2, vmax=0.2, cmap="RdBu_r")
axes[3].set_title("error")
figure.colorbar(error, ax=axes[3], label="px per view step", shrink=0.9)
for axis in axes:
    axis.set_axis_off()

# %%
# The same from a shell::
#
#     lfdepth scenes render demo -o scenes --size 192 --views 7
#     lfdepth estimate scenes/demo -o demo.npz --preview demo.png
#     lfdepth evaluate demo.npz scenes/demo

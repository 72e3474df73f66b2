"""
A refocus video
===============

Sweep the focus from front to back, and write the frames as an animated picture.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import lfdepth
from lfdepth import scenes

lf = scenes.render("demo", size=160, views=7)

# %%
# ``refocus`` shifts all views so that one plane falls into register, and averages them, as a lens as wide as the grid of
# cameras would. Here the plane moves from the nearest to the farthest disparity and back.

low, high = lf.disparity_range
there = [
    Image.fromarray(lfdepth.refocus(lf, float(plane)))
    for plane in np.linspace(high, low, 20)
]
frames = [*there, *there[::-1]]

# %%
# Pillow writes animated WebP, which browsers play, or GIF.

animation = Path(tempfile.mkdtemp()) / "refocus.webp"
frames[0].save(
    animation, save_all=True, append_images=frames[1:], duration=80, loop=0, quality=80
)
print(f"{len(frames)} frames, {animation.stat().st_size / 1000:.0f} kB")

# %%
# With a disparity map, every pixel can be focused at its own disparity. The result is the reference view with the noise
# of all views averaged out.

noisy = scenes.render("demo", size=160, views=7, noise=8)
sharp = lfdepth.all_in_focus(noisy, lfdepth.estimate(noisy))
figure, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
for axis, (title, picture) in zip(
    axes,
    {
        "near in focus": np.asarray(frames[3]),
        "one noisy view": noisy.reference,
        "all in focus": sharp,
    }.items(),
    strict=True,
):
    axis.imshow(picture)
    axis.set_title(title)
    axis.set_axis_off()

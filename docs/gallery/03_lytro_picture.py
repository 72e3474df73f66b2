"""
A Lytro picture
===============

Read a decoded plenoptic picture in ESLF layout, in which the views are interleaved pixel by pixel.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes
from lfdepth.io.pixels import encode_png

# %%
# Stanford's archive has Lytro Illum pictures as ``*_eslf.png``: 14×14 views, of which pixel (v, u) of every 14×14 block
# belongs to view (v, u). **No real picture can be shipped with this page, so a rendered scene is interleaved in the
# same way.** The corner views of the real camera are black, as its lens is round; they are left black here, too.

views = scenes.render("demo", size=128, views=14).views
rows, columns = np.indices((14, 14)) - 6.5
views = views * (np.hypot(rows, columns) < 7.6)[:, :, None, None, None].astype(np.uint8)
mosaic = views.transpose(2, 0, 3, 1, 4).reshape(128 * 14, 128 * 14, 3)
path = Path(tempfile.mkdtemp()) / "IMG_0001_eslf.png"
path.write_bytes(encode_png(mosaic))

# %%
# The name ends in ``_eslf.png``, which is how the format is recognised. The outermost views of the camera are dark and
# blurred, so lfdepth reads the 9×9 views around the middle unless you ask for more.

lf = lfdepth.read(path, check=True)
print(lf.shape)

# %%
# A narrow baseline means small disparities. The camera's geometry is not in the file, so the result stays in pixels per
# view step.

result = lfdepth.estimate(lf)

figure, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
axes[0].imshow(mosaic[700:770, 700:770])
axes[0].set_title("70×70 px of the file")
axes[1].imshow(lf.reference)
axes[1].set_title("reference view")
picture = axes[2].imshow(result.disparity)
axes[2].set_title("disparity")
figure.colorbar(picture, ax=axes[2], label="px per view step", shrink=0.8)
for axis in axes:
    axis.set_axis_off()

# %%
# Raw ``.lfp`` and ``.lfr`` files have to be decoded first, with PlenoptiCam or MATLAB's Light Field Toolbox; see
# :doc:`/formats`.

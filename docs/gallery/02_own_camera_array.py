"""
Your own camera array: from pictures to points in metres
========================================================

A folder of pictures and four numbers about the camera become a point cloud in metres.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes
from lfdepth.io.pixels import encode_png

# %%
# The pictures stand in for those of a camera on two crossed rails: 5 rows and 7 columns, 40 mm apart, named after their
# place in the grid.

rendered = scenes.render("demo", size=(144, 192), views=(5, 7))
folder = Path(tempfile.mkdtemp()) / "shots"
folder.mkdir()
for row, column in np.ndindex(5, 7):
    (folder / f"row{row + 1}_col{column + 1}.png").write_bytes(
        encode_png(rendered.views[row, column])
    )

# %%
# ``read`` takes row and column from the names. The camera is added by hand: the distance between neighbouring cameras,
# focal length and sensor size. All cameras look in the same direction, and pictures were shifted so that what is 3 m
# away does not move: that is the focus distance. ``check=True`` refuses views that are in the wrong order.

lf = lfdepth.read(
    folder,
    check=True,
    baseline_mm=40,
    focal_length_mm=16,
    sensor_size_mm=24,
    focus_distance_m=3,
)
print(lf.shape, lf.camera)

# %%
# Nobody gave a disparity range, so lfdepth estimates it from the views.

result = lfdepth.estimate(lf)
print(f"range {result.range[0]:.2f} to {result.range[1]:.2f} px per view step")
print(result.checks.warnings or "no warnings")

# %%
# With a camera, disparity becomes depth along the optical axis, and points with x to the right, y down and z forward.

depth = lf.camera.disparity_to_depth(result.disparity)
points = lf.camera.points(result.disparity)
print(
    f"depth {depth.min():.2f} to {depth.max():.2f} m, {points.reshape(-1, 3).shape[0]} points"
)

# %%
# Depth as a picture, and the points seen from above. Only pixels with some confidence are shown.

sure = result.confidence > 0.3
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
picture = left.imshow(depth, cmap="viridis_r")
left.set_title("depth")
left.set_axis_off()
figure.colorbar(picture, ax=left, label="m", shrink=0.8)
right.scatter(points[sure][:, 0], points[sure][:, 2], s=2, c=lf.reference[sure] / 255)
right.set(
    title="points seen from above", xlabel="x (m)", ylabel="z (m)", aspect="equal"
)

# %%
# To open them in MeshLab, CloudCompare or Blender, write a PLY file, as points or as a mesh that is cut at depth edges
# (this needs ``pip install 'lfdepth[ply]'``)::
#
#     lfdepth.write("points.ply", result, scene=lf)
#     lfdepth.write("surface.ply", result, scene=lf, mesh=True)

"""
Compare methods
===============

Run several methods on one scene and compare their errors.
"""

import matplotlib.pyplot as plt

import lfdepth
from lfdepth import scenes

# %%
# ``lfdepth methods`` lists what there is: lfdepth's own methods, and published ones that papers compare with. The ones
# here take seconds at this size; the others, such as ``cae`` or ``lf-occ``, take longer.

lf = scenes.render("bars", size=128, views=7)
names = ("fbs", "fbs-sfa", "fbsocc-sfa", "fbs-vis", "oavc")
results = {name: lfdepth.estimate(lf, name) for name in names}

# %%
# A table of the most common scores. Lower is better.

print(f"{'method':12}{'BadPix 0.07':>12}{'BadPix 0.03':>12}{'MSE×100':>9}")
for name, result in results.items():
    scores = lfdepth.evaluate(result, lf)
    print(
        f"{name:12}{scores['badpix_0.07']:12.2f}{scores['badpix_0.03']:12.2f}{scores['mse_x100']:9.2f}"
    )

# %%
# Maps above, signed errors below (red: too near, blue: too far).

low, high = lf.disparity_range
figure, axes = plt.subplots(2, len(names), figsize=(13, 5.4), layout="constrained")
for (above, below), (name, result) in zip(axes.T, results.items(), strict=True):
    above.imshow(result.disparity, vmin=low, vmax=high)
    above.set_title(name)
    below.imshow(result.disparity - lf.truth, vmin=-0.3, vmax=0.3, cmap="RdBu_r")
for axis in axes.flat:
    axis.set_axis_off()

# %%
# Over many scenes, with tables in JSON, CSV and Markdown and one HTML report, the command line does the same. It can be
# interrupted and resumed::
#
#     lfdepth bench suite --methods fbs-vis fbsocc-sfa oavc -o compared

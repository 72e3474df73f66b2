"""
Write a method
==============

A method is one class. This one keeps, for every pixel, the plane on which most views agree in colour.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import matplotlib.pyplot as plt
import numpy as np

import lfdepth
from lfdepth import scenes
from lfdepth.blocks.photo import local_thresholds
from lfdepth.blocks.smoothing import GuidedFilter, guide_image
from lfdepth.methods import Maps, Method, MethodInfo, Problem, Real, Whole, Work

# %%
# Parameters are fields, annotated with their meaning, range, unit and symbol. lfdepth checks every value against its
# annotation, and builds the help text of the command line from it. ``run`` gets the light field and the planes, and an
# engine that does the computing.


@dataclass(frozen=True, kw_only=True)
class Nearest(Method):
    """Count on every plane the views that show the reference view's colour; the fullest plane wins."""

    info: ClassVar = MethodInfo(
        name="nearest", summary="The plane on which most views agree in colour."
    )

    step: Annotated[
        float, Real("Distance between planes.", gt=0, unit="px per view step")
    ] = 0.1
    radius: Annotated[
        int, Whole("Radius of the guided filter.", ge=1, le=100, unit="px")
    ] = 3

    def run(self, problem: Problem, work: Work) -> Maps:
        """Count, smooth, keep the best."""
        lf, planes, engine = problem.lf, problem.planes, work.engine
        views = engine.colour_views(lf, float(np.abs(planes).max()))
        thresholds = engine.upload(local_thresholds(lf.reference))
        smoothing = GuidedFilter(
            guide_image(lf, "colour"), self.radius, 1e-4, engine=engine
        )
        share, smoothed = (engine.empty(problem.size, np.float32) for _ in range(2))
        best = np.full(problem.size, -np.inf, np.float32)
        disparity = np.zeros(problem.size, np.float32)
        for plane in planes:
            engine.photo(views, float(plane), thresholds, share)
            smoothing.smooth(share, smoothed)
            found = engine.download(smoothed)
            better = found > best
            best[better], disparity[better] = found[better], plane
        return Maps(disparity, np.clip(best, 0, 1))


# %%
# An object of the class goes wherever the name of a method does.

lf = scenes.render("demo", size=128, views=7)
results = {
    "nearest": lfdepth.estimate(lf, Nearest(step=0.05)),
    "fbs-vis": lfdepth.estimate(lf),
}

figure, axes = plt.subplots(1, 3, figsize=(11, 4.2), layout="constrained")
axes[0].imshow(lf.reference)
axes[0].set_title("reference view")
for axis, (name, result) in zip(axes[1:], results.items(), strict=True):
    bad = lfdepth.evaluate(result, lf)["badpix_0.07"]
    axis.imshow(
        result.disparity, vmin=lf.disparity_range[0], vmax=lf.disparity_range[1]
    )
    axis.set_title(f"{name}: BadPix 0.07 {bad:.1f} %")
for axis in axes:
    axis.set_axis_off()

# %%
# Installed as a package with an entry point, the method is also available on the command line, in comparisons and in
# submissions: :doc:`/write-a-method`.

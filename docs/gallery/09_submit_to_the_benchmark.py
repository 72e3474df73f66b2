"""
Submit to the 4D Light Field Benchmark
======================================

Make the zip file that the benchmark's website takes, and check it before you upload it.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import lfdepth
from lfdepth import scenes
from lfdepth.bench.submission import submit

# %%
# The benchmark's twelve scenes have to be downloaded from its website, which asks for an e-mail address. **They cannot be
# shipped here, so two rendered scenes take the names of two of them, at a fraction of the size**, to show what is
# written. With the real scenes, leave out ``partial=True``.

work = Path(tempfile.mkdtemp())
(work / "data").mkdir()
scenes.save("demo", work / "data/cotton", size=96, views=5)
scenes.save("bars", work / "data/dino", size=96, views=5)

# %%
# One parameter set for all scenes is what the benchmark asks for. Run times are measured without reading and compiling.

made = submit(work / "data", work / "submission", "fbs-vis", partial=True)
absent = [problem for problem in made.problems if "no folder" in problem]
print(f"{len(absent)} scenes are missing; besides:")
print("\n".join(problem for problem in made.problems if problem not in absent))

# %%
# These are the problems that you want to hear about before you upload: most scenes are missing, and the maps are not
# 512×512 px. With the real data there are none, and the folder also has ``submission.zip``.

for part in ("disp_maps", "runtimes"):
    print(part, sorted(path.name for path in (work / "submission" / part).iterdir()))

# %%
# The maps, as they are in the folder.

figure, axes = plt.subplots(1, 2, figsize=(7, 3.4), layout="constrained")
for axis, path in zip(
    axes, sorted((work / "submission/disp_maps").glob("*.pfm")), strict=True
):
    axis.imshow(lfdepth.read_disparity(path))
    axis.set_title(f"disp_maps/{path.name}")
    axis.set_axis_off()

# %%
# From a shell::
#
#     lfdepth submit path/to/benchmark -o submission
#     lfdepth submit --check submission/submission.zip

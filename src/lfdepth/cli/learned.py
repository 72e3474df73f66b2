"""Commands for learned systems: training, and weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from cyclopts import App

from lfdepth.cli.app import app
from lfdepth.cli.options import Json, Output
from lfdepth.cli.printing import report
from lfdepth.errors import LightFieldError


@app.command(sort_key=14)
def train(
    name: str,
    /,
    *,
    output: Output,
    steps: int = 100_000,
    seed: int = 0,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    threads: int = 1,
    as_json: Json = False,
) -> None:
    """Train a learned method on procedural scenes, which are rendered while it trains.

    If interrupted, rerun the same command: it resumes, and ends with identical weights. For example:

        lfdepth train epinet-s -o trained --steps 20000
        lfdepth estimate cotton -o cotton.pfm --method epinet-s --weights trained/epinet-s.npz

    Parameters
    ----------
    name
        epinet-s, epinet or lfattnet.
    output
        Folder for checkpoint, weights and curves; created if missing.
    steps
        Total number of steps; the learning rate decreases over them.
    seed
        Random seed.
    device
        Where to train; auto takes a GPU if there is one.
    threads
        Threads that compute on the processor, and as many that render; results depend on it a little.
    """
    from lfdepth.cli.progress import Progress
    from lfdepth.training.recipes import recipe_of

    recipe_of(name)
    try:
        import torch  # noqa: F401
    except ImportError:
        raise LightFieldError(
            'train: needs PyTorch, which is not installed; expected the extra "train"; run: pip install '
            '"lfdepth[train]"'
        ) from None
    from lfdepth.training.curves import draw_curves
    from lfdepth.training.loop import train as run

    with Progress() as progress:
        trained = run(
            name, output, steps=steps, seed=seed, device=device, threads=threads, progress=progress.step
        )
    picture = draw_curves(trained, output)
    last = trained.rows[-1]
    facts = {
        "weights": str(trained.weights),
        "curves": str(picture),
        "steps": trained.step,
        "badpix_0.07": last[2],
        "mean_absolute_error": last[5],
    }
    report(facts, as_json, _trained)


def _trained(facts: dict[str, Any]) -> str:
    return (
        f"written  {facts['weights']}\nwritten  {facts['curves']}\n{facts['steps']} steps; on scenes "
        f"that were not trained on: BadPix 0.07 {facts['badpix_0.07']:.2f} %, "
        f"mean error {facts['mean_absolute_error']:.4f} px"
    )


weights_app = App(name="weights", help="Weights of learned methods.", sort_key=15)
app.command(weights_app)


@weights_app.command(name="import")
def import_(name: str, file: Path, /, *, output: Output, as_json: Json = False) -> None:
    """Convert the authors' EPINET weights, in Keras' HDF5 layout, into a file for --weights.

    For example:

        lfdepth weights import epinet pretrained.hdf5 -o epinet.npz

    Parameters
    ----------
    name
        epinet or epinet-s.
    file
        HDF5 file of weights; needs the extra "hdf5".
    output
        NPZ file to write.
    """
    from lfdepth.training.weights import import_weights

    import_weights(name, file, output)
    report({"written": str(output)}, as_json, lambda _: f"written  {output}")


@weights_app.command
def export(name: str, /, *, output: Output, weights: Path | None = None, as_json: Json = False) -> None:
    """Write a learned method as an ONNX file, which --weights takes and other programs run.

    For example:

        lfdepth weights export epinet-s -o epinet-s.onnx

    Parameters
    ----------
    name
        epinet-s, epinet or lfattnet.
    output
        ONNX file to write.
    weights
        NPZ file of weights; the package's own by default.
    """
    from lfdepth.training.weights import export_weights

    export_weights(name, output, weights=weights)
    report({"written": str(output)}, as_json, lambda _: f"written  {output}")

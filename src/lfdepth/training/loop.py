"""Training: the same weights for the same seed, also after a break at any time."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic, make_folder
from lfdepth.learned.weights import read_arrays
from lfdepth.training.batches import Batches, Variation
from lfdepth.training.nets import Trainee, trainee
from lfdepth.training.packing import packed
from lfdepth.training.recipes import Recipe
from lfdepth.training.scenes import Window, validation_scenes
from lfdepth.version import __version__

CHECKPOINT, RUN, CURVES = "checkpoint.npz", "run.json", "curves.csv"
"""Files of a training folder, beside NAME.npz with the weights and curves.png."""
HEADINGS = ("step", "loss", "badpix_0.07", "badpix_0.03", "badpix_0.01", "mean_absolute_error")
"""Columns of the curves; the shares, in percent, and the last are of the validation scenes."""
_OPTIMISER = "optimiser."
_ROWS = "rows"
_STEP = "step"


@dataclass(frozen=True)
class Training:
    """What was trained.

    Attributes
    ----------
    weights
        File of weights.
    step
        Steps done.
    rows
        Curves; columns as in `HEADINGS`.
    """

    weights: Path
    step: int
    rows: list[list[float]]


def device_of(name: str) -> torch.device:
    """The device of a name: auto, cpu or cuda.

    Raises
    ------
    LightFieldError
        If it is not there.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name == "cuda" and not torch.cuda.is_available():
        raise LightFieldError(
            "device: found no GPU that PyTorch can use, expected one for cuda; choose cpu or auto"
        )
    return torch.device(name)


def train(
    name: str,
    folder: str | Path,
    *,
    steps: int,
    seed: int = 0,
    device: str = "auto",
    recipe: Recipe | None = None,
    net: Trainee | None = None,
    threads: int = 1,
    progress: Callable[[int, int, str], None] | None = None,
) -> Training:
    """Train a learned system on scenes rendered meanwhile, from where an earlier run in the folder stopped.

    Parameters
    ----------
    name
        Name of the system.
    folder
        Where checkpoint, weights and curves go; made if it does not exist.
    steps
        Steps in all.
    seed
        Of the weights, the scenes and the variations; not negative.
    device
        auto, cpu or cuda.
    recipe, net
        Sizes of the training and the net; by default those of the name.
    threads
        Threads that compute on the processor, and as many that render. On other numbers sums may round
        otherwise.
    progress
        Called with (steps done, steps in all, what was done).

    Raises
    ------
    LightFieldError
        If the folder holds another run, or cannot be written, or the device is not there.
    """
    if steps < 1 or seed < 0:
        raise LightFieldError(
            f"training: found {steps} steps and seed {seed}, expected at least 1 step and a seed of at least "
            "0; correct them"
        )
    place, chosen = device_of(device), net or trainee(name)
    used = recipe or chosen.recipe
    folder = make_folder(Path(folder))
    run = {
        "name": name,
        "steps": steps,
        "seed": seed,
        "version": __version__,
        "recipe": json.loads(json.dumps(asdict(used))),
    }
    _claim(folder, run)
    torch.set_num_threads(threads)
    torch.manual_seed(seed)
    state = _State(chosen, place, used)
    state.resume(folder / CHECKPOINT)
    if state.step < steps:
        _run(state, folder, name, steps, seed, threads, progress)
    return Training(folder / f"{name}.npz", state.step, state.rows)


def _claim(folder: Path, run: dict[str, Any]) -> None:
    """Write what a folder is for; LightFieldError where it is for something else."""
    path = folder / RUN
    try:
        there = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
    except (OSError, ValueError):
        there = {}
    if there is None:
        if (folder / CHECKPOINT).exists():
            there = {}
        else:
            _write(path, json.dumps(run, indent=1).encode())
            return
    differing = [key for key in run if there.get(key) != run[key]]
    if differing:
        found = (
            ", ".join(f"{key} {there.get(key)!r}" for key in differing if key != "recipe") or "another recipe"
        )
        raise LightFieldError(
            f"{folder}: found a training with {found}, expected this one's; give the same values, or another "
            "folder"
        )


class _State:
    """A net in training, its optimiser, and its curves."""

    def __init__(self, chosen: Trainee, device: torch.device, recipe: Recipe) -> None:
        self.chosen, self.device, self.recipe = chosen, device, recipe
        self.net = chosen.build().to(device)
        self.optimiser = torch.optim.Adam(self.net.parameters(), lr=recipe.rate, betas=(0.9, 0.99))
        self.step = 0
        self.rows: list[list[float]] = []

    def weights(self) -> dict[str, np.ndarray]:
        """All weights by name."""
        return {
            key: value.detach().cpu().numpy()
            for key, value in self.net.state_dict().items()
            if value.is_floating_point()
        }

    def save(self, folder: Path, name: str) -> None:
        """Checkpoint, weights and curves, each whole or not at all; the checkpoint first."""
        arrays = self.weights()
        named = dict(self.net.named_parameters())
        for key, parameter in named.items():
            for part, value in self.optimiser.state[parameter].items():
                arrays[f"{_OPTIMISER}{part}.{key}"] = np.asarray(value.cpu().numpy(), np.float32)
        rows = np.array(self.rows, np.float64).reshape(-1, len(HEADINGS))
        arrays |= {_ROWS: rows, _STEP: np.array(self.step, np.float64)}
        _write(folder / CHECKPOINT, packed(arrays))
        _write(folder / f"{name}.npz", packed(self.weights()))
        table = io.StringIO()
        writer = csv.writer(table, lineterminator="\n")
        writer.writerow(HEADINGS)
        writer.writerows([[int(row[0]), *(f"{value:.6g}" for value in row[1:])] for row in self.rows])
        _write(folder / CURVES, table.getvalue().encode())

    def resume(self, path: Path) -> None:
        """Go on from a checkpoint, if there is one."""
        if not path.exists():
            return
        arrays = read_arrays(path, exact=True)
        weights = {key: torch.as_tensor(arrays[key]) for key in self.weights() if key in arrays}
        named = dict(self.net.named_parameters())
        wanted = {key: value.shape for key, value in self.weights().items()}
        if {key: tuple(value.shape) for key, value in weights.items()} != wanted or _STEP not in arrays:
            raise LightFieldError(
                f"{path}: found the checkpoint of another net; expected this one's; choose another folder"
            )
        self.net.load_state_dict(weights, strict=False)
        for key, parameter in named.items():
            self.optimiser.state[parameter] = {
                part: torch.as_tensor(arrays[f"{_OPTIMISER}{part}.{key}"], dtype=torch.float32).to(
                    "cpu" if part == "step" else self.device
                )
                for part in ("step", "exp_avg", "exp_avg_sq")
            }
        self.step = int(arrays[_STEP])
        self.rows = arrays[_ROWS].tolist()


def _write(path: Path, data: bytes) -> None:
    with atomic(path) as temporary:
        temporary.write_bytes(data)


def _run(
    state: _State,
    folder: Path,
    name: str,
    steps: int,
    seed: int,
    threads: int,
    progress: Callable[[int, int, str], None] | None,
) -> None:
    recipe, chosen = state.recipe, state.chosen
    window = Window(
        seed,
        chosen.positions,
        count=recipe.scenes,
        size=recipe.size,
        pace=recipe.pace,
        device=state.device,
        threads=threads,
    )
    held = validation_scenes(chosen.positions, recipe.validation, recipe.size, state.device)
    generator = torch.Generator(state.device)
    batches = Batches(chosen.positions, Variation(recipe.crop, chosen.border), generator)
    loss, since = 0.0, 0
    with window:
        while state.step < steps:
            window.at(state.step)
            generator.manual_seed((seed << 40) + state.step)
            loss, since = loss + _step(state, window, batches, steps), since + 1
            state.step += 1
            if progress:
                progress(state.step, steps, f"{name}: step")
            if state.step % recipe.every == 0 or state.step == steps:
                state.rows.append([state.step, loss / since, *_scores(state, *held)])
                state.save(folder, name)
                loss, since = 0.0, 0


def _step(state: _State, window: Window, batches: Batches, steps: int) -> float:
    recipe = state.recipe
    share = state.step / steps
    rate = min(1.0, (state.step + 1) / recipe.warm) * (0.5 * (1 + math.cos(math.pi * share)) + 1e-3)
    for group in state.optimiser.param_groups:
        group["lr"] = recipe.rate * rate
    grey, target = batches.draw(window.views, window.truth, recipe.batch)
    state.net.train()
    found = state.net(state.chosen.arranged(grey))
    loss = (found - target).abs().mean()
    state.optimiser.zero_grad(set_to_none=True)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(state.net.parameters(), 5.0)
    state.optimiser.step()
    return float(loss.detach())


@torch.no_grad()
def _scores(state: _State, views: torch.Tensor, truth: torch.Tensor) -> list[float]:
    """Shares of bad pixels, %, and the mean absolute error, on scenes without variation."""
    from lfdepth.lightfield import LUMA

    state.net.eval()
    errors, border = [], state.chosen.border
    weights = torch.tensor(LUMA, device=views.device) / 255
    for i in range(len(views)):
        found = state.net(state.chosen.arranged(views[i : i + 1].float() @ weights))
        inner = slice(border, truth.shape[1] - border)
        errors.append((found[0] - truth[i, inner, inner]).abs().flatten())
    error = torch.cat(errors)
    return [100 * float((error > limit).float().mean()) for limit in (0.07, 0.03, 0.01)] + [
        float(error.mean())
    ]

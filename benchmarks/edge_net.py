"""Train the network that decides to which surface pixels beside depth edges belong.

    python benchmarks/edge_net.py look FOLDER [--scenes 74] [--balls 37]
    python benchmarks/edge_net.py train FOLDER OUT.npz [--epochs 8]

`look` estimates maps of scenes left to chance (series 100, 160 px, 9×9 views) and of balls with little
texture, whose rims are in shadow; some are blurred a little, as a camera's pixels are, and noisy. It keeps
what the network (`lfdepth.blocks.edge_net`) is told of the pixels beside their depth edges, in the map before
and after the refinement. What is there already is not made again.
`train` fits the weights (needs torch); every sixth scene is left out and scored.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lfdepth
from lfdepth import LightField
from lfdepth.blocks.edge_net import look_at_edges
from lfdepth.scenes import chance
from lfdepth.scenes.model import Ellipsoid, Layer, Scene, pack

SERIES, SIZE, VIEWS, SAMPLES = 100, 160, 9, 3
MOST_BLUR = 0.22
"""Largest share of a level that goes to either neighbour."""
NOISE = (0.0, 0.7, 0.0, 0.7, 2.0)
"""Standard deviations in 8-bit levels, in turn."""
CLOSE = 0.3
"""Part of a jump within which one of the two surfaces is the true one."""

Array = NDArray[Any]


def balls(number: int) -> Scene:
    """Balls with little texture, from full light to shadow, before a wall or in a room."""
    rng = np.random.default_rng([number, 77])
    composer = chance._Composer(rng, SIZE, chance._textures(SERIES, number % 6))
    composer.span, composer.plainness = min(composer.span, 5.0), 0.7
    layers = composer._room() if composer.chance(0.2) else composer._wall()
    for _ in range(int(rng.integers(4, 12))):
        x, y = composer.place()
        rx, ry = composer.length(0.06, 0.45), composer.length(0.06, 0.45)
        bulge = min(composer.uniform(0.05, 0.5) * composer.span, 0.1 * min(rx, ry))
        ball = Ellipsoid(x, y, rx, ry, composer.depth(0.15, 0.9), bulge)
        layers = [*layers, Layer(ball, composer.paint(composer.uniform(0, 0.5)))]
        if composer.chance(0.2):
            layers = layers + composer._sheet()
    return Scene(layers)


def rendered(scene: Scene, number: int) -> LightField:
    """Views of a scene as a camera would take them, and its truth."""
    from lfdepth.engines.cpu.kernels import scenes as kernels

    packed, rng = pack(scene), np.random.default_rng([number, 5])
    light = [
        kernels.render_view(packed, float(u), float(v), SIZE, SIZE, SAMPLES) for v, u in chance.whole(VIEWS)
    ]
    views: Array = np.stack(light).reshape(VIEWS, VIEWS, SIZE, SIZE, 3).astype(np.float32)
    truth, _ = kernels.trace(packed, 0.0, 0.0, np.arange(SIZE, dtype=np.float64), SIZE, 0.0, 1.0)
    share = rng.uniform(0, MOST_BLUR) if number % 3 else 0.0
    for axis in (2, 3):
        before, after = np.arange(SIZE) - 1, np.arange(SIZE) + 1
        sides = [views.take(np.clip(places, 0, SIZE - 1), axis) for places in (before, after)]
        views = (1 - 2 * share) * views + share * (sides[0] + sides[1])
    views = views + rng.normal(0, 1, views.shape) * NOISE[number % len(NOISE)]
    return LightField(np.clip(np.rint(views), 0, 255).astype(np.uint8), truth=truth.astype(np.float32))


def looks(lf: LightField) -> Iterator[dict[str, Any]]:
    """What the network is told, and what is true, in the maps before and after the refinement."""
    trace = lfdepth.Trace(keep=["decisions"])
    refined = lfdepth.estimate(lf, "fbs-vis", edge_net=False, trace=trace).disparity
    rough = lfdepth.estimate(lf, "fbs-vis", edge_net=False, effort="fast").disparity
    assert lf.truth is not None
    for disparity in (rough, refined):
        pixels = look_at_edges(lf, disparity, trace.kept["decisions"][-1], exponent=1.0)
        truth = lf.truth[pixels.rows, pixels.columns]
        to_near, to_far = np.abs(pixels.near - truth), np.abs(pixels.far - truth)
        gap = pixels.near - pixels.far
        known = np.minimum(to_near, to_far) < CLOSE * gap
        told = {"features": pixels.features.astype(np.float16), "near": to_near < to_far, "gap": gap}
        yield {name: each[known] for name, each in {**told, "now": pixels.front}.items()}


def look(chosen: argparse.Namespace) -> None:
    chosen.folder.mkdir(parents=True, exist_ok=True)
    scenes = [("chance", n) for n in range(chosen.scenes)] + [("balls", n) for n in range(chosen.balls)]
    for kind, number in scenes:
        paths = [chosen.folder / f"{kind}-{number}-{when}.npz" for when in ("rough", "refined")]
        if all(path.exists() for path in paths):
            continue
        scene = balls(number) if kind == "balls" else chance.chance_scene(number, SIZE, SERIES)
        for path, found in zip(paths, looks(rendered(scene, number)), strict=True):
            np.savez(path, **found)
        print(f"{kind} {number}", flush=True)


def gathered(paths: list[Path]) -> tuple[Array, Array, Array, Array]:
    """Features, truth, weights and present sides; a wide jump counts more, a scene with many edges less."""
    parts = []
    for path in paths:
        with np.load(path) as found:
            gap, near = found["gap"], found["near"]
            weight = (np.minimum(gap, 1) + 0.2) / np.sqrt(len(gap) / 2000 + 0.5)
            parts.append((found["features"].astype(np.float32), near, weight, found["now"]))
    features, near, weight, now = (np.concatenate(each) for each in zip(*parts, strict=True))
    return features, near.astype(np.float32), weight.astype(np.float32), now


def train(chosen: argparse.Namespace) -> None:
    import torch
    from torch import nn

    torch.manual_seed(0)
    paths = sorted(chosen.folder.glob("*.npz"))
    kept_back = [path for path in paths if int(path.stem.split("-")[1]) % 6 == 0]
    features, near, weight, _ = gathered([path for path in paths if path not in kept_back])
    mean, deviation = features.mean(axis=0), features.std(axis=0) + np.float32(1e-3)
    told, truth, weights = (torch.from_numpy(each) for each in ((features - mean) / deviation, near, weight))
    net = nn.Sequential(
        nn.Linear(features.shape[1], 32), nn.ReLU(), nn.Linear(32, 16), nn.ReLU(), nn.Linear(16, 1)
    )
    batch = 512
    steps = chosen.epochs * (len(truth) // batch)
    optimiser = torch.optim.AdamW(net.parameters(), lr=2e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=steps + 1)
    for _ in range(chosen.epochs):
        order = torch.randperm(len(truth))
        for at in range(0, len(truth) // batch * batch, batch):
            some = order[at : at + batch]
            losses = nn.functional.binary_cross_entropy_with_logits(
                net(told[some])[:, 0], truth[some], reduction="none"
            )
            optimiser.zero_grad()
            (losses * weights[some]).mean().backward()
            optimiser.step()
            schedule.step()
    layers = [
        (each.weight.detach().numpy().T, each.bias.detach().numpy())
        for each in net
        if isinstance(each, nn.Linear)
    ]
    first, offset = layers[0]
    layers[0] = first / deviation[:, None], offset - (mean / deviation) @ first  # of features as they are
    arrays: dict[str, Any] = {}
    for i, (matrix, offset) in enumerate(layers):
        arrays |= {f"matrix_{i}": matrix.astype(np.float32), f"offset_{i}": offset.astype(np.float32)}
    np.savez(chosen.out, **arrays)
    features, near, weight, now = gathered(kept_back)
    with torch.no_grad():
        odds = net(torch.from_numpy((features - mean) / deviation))[:, 0].numpy()
    wrong = [float(np.average((side != near), weights=weight)) for side in (now, odds > 0)]
    left_out = f"{wrong[0]:.2%} before, {wrong[1]:.2%} after"
    print(f"{steps} steps; on the wrong side in the scenes left out: {left_out}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    acts = parser.add_subparsers(required=True)
    looking, training = acts.add_parser("look"), acts.add_parser("train")
    for each, act in ((looking, look), (training, train)):
        each.add_argument("folder", type=Path)
        each.set_defaults(act=act)
    looking.add_argument("--scenes", type=int, default=74)
    looking.add_argument("--balls", type=int, default=37)
    training.add_argument("out", type=Path)
    training.add_argument("--epochs", type=int, default=8)
    chosen = parser.parse_args()
    chosen.act(chosen)


if __name__ == "__main__":
    main()

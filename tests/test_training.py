"""Training: LFAttNet's sizes, that a loss falls, that a break changes nothing, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfdepth import LightFieldError

torch = pytest.importorskip("torch", reason="needs the extra train")

from lfdepth.learned.lfattnet import lfattnet_onnx  # noqa: E402
from lfdepth.learned.shape import EpinetShape  # noqa: E402
from lfdepth.learned.stacks import stack_indices  # noqa: E402
from lfdepth.learned.torch_lfattnet import Lfattnet  # noqa: E402
from lfdepth.scenes.chance import cross, render  # noqa: E402
from lfdepth.training.batches import Batches, Variation  # noqa: E402
from lfdepth.training.loop import CHECKPOINT, CURVES, train  # noqa: E402
from lfdepth.training.nets import epinet_trainee  # noqa: E402
from lfdepth.training.recipes import Recipe  # noqa: E402

SHAPE = EpinetShape(filters=4, merged_blocks=1, stream_blocks=1, views=5)
RECIPE = Recipe(batch=4, crop=20, rate=5e-3, warm=5, scenes=2, size=40, pace=10, validation=1, every=10)


def run(folder: Path, steps: int, recipe: Recipe = RECIPE, **options: Any) -> list[list[float]]:
    net = epinet_trainee(SHAPE, recipe)
    return train("epinet-s", folder, steps=steps, device="cpu", net=net, recipe=recipe, **options).rows


def numbers(module: Any) -> tuple[int, int]:
    """Trainable weights, and with the statistics of batch normalisation."""
    trainable = sum(each.numel() for each in module.parameters())
    statistics = sum(each.numel() for name, each in module.named_buffers() if "running" in name)
    return trainable, trainable + statistics


def test_lfattnet_has_the_published_numbers_of_weights() -> None:
    net = Lfattnet()
    assert numbers(net) == (5_055_329, 5_058_133)
    assert numbers(net.features)[1] == 34_868
    assert numbers(net.attention)[1] == 57_815


@pytest.mark.slow
def test_lfattnet_as_onnx_is_the_same(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="needs the extra onnx")
    from lfdepth.learned.onnx_running import OnnxNetwork

    generator = torch.Generator().manual_seed(0)
    net = Lfattnet().eval()
    with torch.no_grad():
        for name, value in net.named_buffers():
            if "running_var" in name:
                value.uniform_(0.5, 2, generator=generator)
        net.last.weight.mul_(30_000)
        weights = {k: v.numpy() for k, v in net.state_dict().items() if v.is_floating_point()}
        views = torch.rand(1, 81, 16, 32, generator=generator)
        expected = net(views)[0].numpy()
    assert np.ptp(expected) > 0.1
    path = tmp_path / "net.onnx"
    path.write_bytes(lfattnet_onnx(weights))
    found = OnnxNetwork(path, (81,), "lfattnet")(views[0].numpy())
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.slow
def test_lfattnet_moves_views_onto_each_other() -> None:
    """Of views that show a plane at D, features coincide in the slice D, whatever the weights."""
    picture = torch.rand(48, 48, generator=torch.Generator().manual_seed(0))
    net = Lfattnet().eval()
    disparity = 1
    moved = [
        torch.roll(picture, (-disparity * v, -disparity * u), (0, 1))
        for v in range(-4, 5)
        for u in range(-4, 5)
    ]
    with torch.no_grad():
        net.features.pools = torch.nn.ModuleList(
            [torch.nn.Sequential(torch.nn.Conv2d(16, 4, 1)) for _ in "1234"]
        )
        for pool in net.features.pools:  # pooling is not blind to where the pools lie
            torch.nn.init.zeros_(pool[0].weight)
        volume = net.volume(torch.stack(moved)[None])[0].reshape(81, 4, 9, 48, 48)
    inner = volume[:, :, 4 + disparity, 22:26, 22:26]
    torch.testing.assert_close(inner, inner[40:41].expand_as(inner), atol=1e-4, rtol=1e-3)
    other = volume[:, :, 4, 22:26, 22:26]
    assert (other - other[40:41]).abs().max() > 1e-2


def test_turned_crops_have_the_truth_of_turned_views() -> None:
    positions = cross(3)
    samples = [render(number, 40, positions, samples=2) for number in range(4)]
    views = torch.as_tensor(np.stack([each.views for each in samples]))
    truth = torch.as_tensor(np.stack([each.truth for each in samples]))
    rule = Variation(crop=32, border=0, scaled=0.3, noisy=0)
    grey, target = Batches(positions, rule, torch.Generator().manual_seed(0)).draw(views, truth, 24)
    rows, columns = np.mgrid[:32, :32]
    errors: dict[int, list[float]] = {1: [], -1: []}
    for crop, true in zip(grey.numpy(), target.numpy(), strict=True):
        for picture, (v, u) in zip(crop, positions, strict=True):
            for sign, found in errors.items():
                y = np.clip(np.rint(rows - sign * true * v).astype(int), 0, 31)
                x = np.clip(np.rint(columns - sign * true * u).astype(int), 0, 31)
                found.append(float(np.median(np.abs(picture[y, x] - crop[positions.index((0, 0))]))))
    assert np.mean(errors[1]) < 0.5 * np.mean(errors[-1])


def test_fifty_steps_lower_the_loss(tmp_path: Path) -> None:
    rows = run(tmp_path, 50, replace(RECIPE, pace=50))
    assert rows[-1][0] == 50
    assert rows[-1][1] < 0.8 * rows[0][1]


def test_two_runs_give_the_same_weights_and_a_break_changes_nothing(tmp_path: Path) -> None:
    run(tmp_path / "whole", 30)

    class StopError(Exception):
        pass

    def stop(done: int, total: int, what: str) -> None:
        if done == 17:  # between two checkpoints, as after kill -9: what came after the first is lost
            raise StopError

    with pytest.raises(StopError):
        run(tmp_path / "broken", 30, progress=stop)
    run(tmp_path / "broken", 30)
    for name in (CHECKPOINT, CURVES, "epinet-s.npz"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "broken" / name).read_bytes()
    run(tmp_path / "other", 30, seed=1)
    assert (tmp_path / "whole" / "epinet-s.npz").read_bytes() != (
        tmp_path / "other" / "epinet-s.npz"
    ).read_bytes()


def test_the_folder_of_another_run_is_left_alone(tmp_path: Path) -> None:
    run(tmp_path, 10)
    before = (tmp_path / CHECKPOINT).read_bytes()
    with pytest.raises(LightFieldError, match="found a training with seed 0, expected"):
        run(tmp_path, 10, seed=1)
    (tmp_path / CHECKPOINT).write_bytes(before[:1000])
    with pytest.raises(LightFieldError, match=r"checkpoint\.npz: found no complete NPZ"):
        run(tmp_path, 10)
    assert (tmp_path / CHECKPOINT).read_bytes() == before[:1000]


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_device_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(LightFieldError, match="found no GPU"):
        train("epinet-s", tmp_path, steps=1, device="cuda")


def test_stacks_are_found_among_the_views_of_a_scene() -> None:
    order = stack_indices(9, cross(9))
    assert order.shape == (4, 9)
    assert sorted(set(order.reshape(-1).tolist())) == list(range(33))

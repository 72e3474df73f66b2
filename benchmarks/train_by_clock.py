"""Train EPINETs within a given time: scenes are rendered by other processes, as many as there is time for.

    python benchmarks/train_by_clock.py render FOLDER --worker 0 --workers 8 --until EPOCH
    python benchmarks/train_by_clock.py train FOLDER OUT --nets epinet-s:32:1 --until EPOCH
    python benchmarks/train_by_clock.py ship OUT epinet-s "how it was made"

EPOCH is the second since 1970 at which to stop. A net is given as NAME:BATCH:STEPS, with
STEPS steps in each round.
The weights depend on the speed of the machine; `lfdepth train` gives the same ones everywhere.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import math
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from lfdepth.scenes.chance import SET, cross, render

SIZE = 160
VALIDATION = 1
"""Series of scenes that nothing is trained on; 0 is trained on."""
CAPACITY = 7200
_WARM = 6


def save(path: Path, **arrays: Any) -> None:
    """Write arrays, whole or not at all."""
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.savez(file, **arrays)
    part.replace(path)


def render_sets(chosen: argparse.Namespace) -> None:
    folder, positions = chosen.folder, cross(9)
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(VALIDATION, k) for k in range(chosen.validation) if k % chosen.workers == chosen.worker]
    k = chosen.worker
    while time.time() < chosen.until and k * SET < CAPACITY:
        if jobs and k != chosen.worker:
            series, number = jobs.pop()
        else:
            series, number, k = 0, k, k + chosen.workers
        made = [
            render(number * SET + i, SIZE, positions, 3 if i % 3 == 0 else 2, seed=series)
            for i in range(SET)
            if time.time() < chosen.until
        ]
        if len(made) == SET:
            name = f"{'validation' if series else 'train'}-{number:05d}.npz"
            save(
                folder / name,
                views=np.stack([s.views for s in made]),
                truth=np.stack([s.truth for s in made]),
            )


def train(chosen: argparse.Namespace) -> None:
    import torch

    from lfdepth.learned.shape import EPINETS
    from lfdepth.learned.stacks import stack_indices
    from lfdepth.learned.torch_epinet import Epinet
    from lfdepth.learned.weights import read_arrays
    from lfdepth.training.batches import Batches, Variation

    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    cuda = device.type == "cuda"
    torch.backends.cudnn.benchmark = True
    torch.set_num_threads(2)
    torch.manual_seed(0)
    positions = cross(9)
    order = torch.as_tensor(stack_indices(9, positions), device=device)
    capacity = min(CAPACITY, chosen.capacity)
    views = torch.empty((capacity, len(positions), SIZE, SIZE, 3), dtype=torch.uint8, device=device)
    truth = torch.empty((capacity, SIZE, SIZE), device=device)
    held, listed = [0], [0]
    # Scenes by the chance to be drawn: those of small disparities stand here three times.
    listing = torch.zeros(3 * capacity, dtype=torch.int64, device=device)
    length = torch.ones((), device=device)
    busy = threading.Lock()
    validation: list[tuple[Any, Any]] = []
    done = threading.Event()

    def load() -> None:
        while not done.is_set():
            for path in sorted(chosen.folder.glob("*.npz")):
                with np.load(path) as file:
                    new = file["views"], file["truth"]
                path.unlink()
                if path.name.startswith("validation"):
                    with busy:
                        validation.append(
                            (torch.as_tensor(new[0]).to(device), torch.as_tensor(new[1]).to(device))
                        )
                elif held[0] + SET <= capacity:
                    part = slice(held[0], held[0] + SET)
                    often = np.where(np.abs(new[1]).max((1, 2)) <= chosen.usual, 3, 1)
                    entries = np.repeat(np.arange(held[0], held[0] + SET), often)
                    with busy:
                        views[part] = torch.as_tensor(new[0]).to(device)
                        truth[part] = torch.as_tensor(new[1]).to(device)
                        listing[listed[0] : listed[0] + len(entries)] = torch.as_tensor(entries).to(device)
                        listed[0] += len(entries)
                        length.fill_(listed[0])
                        if cuda:
                            torch.cuda.synchronize()
                        held[0] += SET
            time.sleep(0.3)

    threading.Thread(target=load, daemon=True).start()

    class Run:
        def __init__(self, text: str) -> None:
            self.name, batch, steps = text.split(":")
            self.batch, self.steps, self.shape = int(batch), int(steps), EPINETS[self.name]
            self.net = Epinet(self.shape)
            if chosen.start and (file := chosen.start / f"{self.name}.npz").is_file():
                arrays = {k: torch.as_tensor(v) for k, v in read_arrays(file).items()}
                self.net.load_state_dict(arrays, strict=False)
            self.net.to(device, memory_format=torch.channels_last)
            self.mean = {k: v.detach().clone().float() for k, v in self.net.state_dict().items()}
            self.rate = torch.tensor(chosen.rate, device=device)
            self.optimiser = torch.optim.Adam(
                self.net.parameters(),
                lr=self.rate if cuda else chosen.rate,
                betas=(0.9, 0.99),
                fused=cuda,
                capturable=cuda,
            )
            # a graph knows the state of the default generator alone
            generator = torch.cuda.default_generators[device.index or 0] if cuda else torch.Generator()
            self.batches = Batches(positions, Variation(chosen.crop, self.shape.lost // 2), generator)
            self.count, self.loss = 0, torch.zeros((), device=device)
            self.since = 0
            self.graph: Any = None
            self.coarse, self.warmed = False, 0
            self.side = torch.cuda.Stream() if cuda else None

        def learn(self) -> None:
            """One step, without anything that asks the processor."""
            drawn = torch.rand(self.batch, device=device) * length
            grey, target = self.batches.draw(views, truth, self.batch, listing[drawn.long()])
            with torch.autocast(device.type, torch.bfloat16, enabled=self.coarse, cache_enabled=False):
                found = self.net(grey[:, order])
            loss = (found.float() - target).abs().mean()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0, foreach=True)
            self.optimiser.step()
            self.loss.add_(loss.detach())

        def capture(self) -> None:
            """Record a step as a graph, which is played back without the processor's help."""
            with busy:
                torch.cuda.synchronize()
                self.optimiser.zero_grad(set_to_none=True)
                graph = torch.cuda.CUDAGraph()
                with torch.cuda.graph(graph, capture_error_mode="thread_local"):
                    self.learn()
                torch.cuda.synchronize()
                self.graph = graph

        def step(self, share: float) -> None:
            warm = min(1.0, (self.count + 1) / 200)
            rate = chosen.rate * warm * (0.5 * (1 + math.cos(math.pi * share)) + 1e-3)
            if cuda:
                self.rate.fill_(rate)
            else:
                self.optimiser.param_groups[0]["lr"] = rate
            coarse = cuda and share < chosen.fine_from
            if coarse != self.coarse:
                self.graph, self.coarse, self.warmed = None, coarse, 0
            if chosen.graph and cuda and self.graph is None and self.warmed == _WARM:
                self.capture()
                print(f"{self.name}: recorded a step, bfloat16 {self.coarse}", flush=True)
            if self.graph is not None:
                self.graph.replay()
            else:
                self.optimiser.zero_grad(set_to_none=True)
                if self.side is not None:
                    self.side.wait_stream(torch.cuda.current_stream())
                with torch.cuda.stream(self.side):
                    self.learn()
                if self.side is not None:
                    torch.cuda.current_stream().wait_stream(self.side)
                self.warmed += 1
            self.count, self.since = self.count + 1, self.since + 1
            if self.count % 8 == 0:
                keep = min(0.984, 1 - 8 / (self.count + 8))
                state = self.net.state_dict()
                names = [k for k, v in state.items() if v.is_floating_point()]
                torch._foreach_lerp_([self.mean[k] for k in names], [state[k] for k in names], 1 - keep)

        def weights(self) -> dict[str, np.ndarray]:
            return {k: self.mean[k].cpu().numpy() for k in self.shape.arrays()}

        @torch.no_grad()
        def scores(self) -> list[float]:
            if not validation:
                return [math.nan] * 4
            net = Epinet(self.shape).to(device, memory_format=torch.channels_last)
            net.load_state_dict(self.mean, strict=False)
            net.eval()
            grey = torch.tensor([0.299, 0.587, 0.114], device=device) / 255
            errors, border = [], self.shape.lost // 2
            for seen, true in list(validation):
                for i in range(0, SET, 4):
                    found = net((seen[i : i + 4].float() @ grey)[:, order])
                    errors.append((found - true[i : i + 4, border:-border, border:-border]).abs().flatten())
            error = torch.cat(errors)
            return [100 * float((error > t).float().mean()) for t in (0.07, 0.03, 0.01)] + [
                float(error.mean())
            ]

    runs = [Run(text) for text in chosen.nets]
    chosen.out.mkdir(parents=True, exist_ok=True)
    with (chosen.out / "curves.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["net", "seconds", "step", "scenes", "loss", "bad007", "bad003", "bad001", "mae"])

        def report(now: float) -> None:
            for run in runs:
                row = [
                    run.name,
                    round(now, 1),
                    run.count,
                    held[0],
                    float(run.loss) / max(1, run.since),
                    *run.scores(),
                ]
                run.loss.zero_()
                run.since = 0
                table.writerow(row)
                print(*row, flush=True)
                kind = np.float32 if run.shape.filters < 50 else np.float16
                save(chosen.out / f"{run.name}.npz", **{k: v.astype(kind) for k, v in run.weights().items()})
            file.flush()

        while held[0] < SET:
            if time.time() > chosen.until:
                raise SystemExit("no scenes were rendered in time")
            time.sleep(0.2)
        begun = time.time()
        duration = chosen.until - 6 - begun
        reported = 0.0
        while (now := time.time() - begun) < duration:
            for run in runs:
                for _ in range(run.steps):
                    run.step(min(1.0, now / duration))
            if cuda and runs[0].count % 16 < runs[0].steps:
                torch.cuda.synchronize()
            if now - reported > chosen.every:
                report(now)
                reported = now
        report(time.time() - begun)
    done.set()


def ship(chosen: argparse.Namespace) -> None:
    """Put weights into the package, convolutions in half precision, with what is known of them."""
    from lfdepth.learned.weights import SHIPPED, read_arrays
    from lfdepth.training.packing import packed

    arrays = read_arrays(chosen.out / f"{chosen.name}.npz")
    halved = {k: v.astype(np.float32 if ".norm." in k else np.float16) for k, v in arrays.items()}
    with (chosen.out / "curves.csv").open() as file:
        last = [row for row in csv.DictReader(file) if row["net"] == chosen.name][-1]
    facts = {
        "how": chosen.how,
        "steps": int(last["step"]),
        "scenes": int(last["scenes"]),
        "validation": {key: float(last[key]) for key in ("bad007", "bad003", "bad001", "mae")},
        "scores": chosen.scores.split("; "),
        "data": "procedural scenes of lfdepth.scenes.chance, series 0, nothing of the benchmark",
        "sha256": hashlib.sha256(packed(halved)).hexdigest(),
    }
    SHIPPED.mkdir(exist_ok=True)
    (SHIPPED / f"{chosen.name}.npz").write_bytes(packed(halved))
    (SHIPPED / f"{chosen.name}.json").write_text(json.dumps(facts, indent=1) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    which = parser.add_subparsers(required=True)
    one = which.add_parser("render")
    one.add_argument("folder", type=Path)
    one.add_argument("--worker", type=int, default=0)
    one.add_argument("--workers", type=int, default=1)
    one.add_argument("--validation", type=int, default=3, help="sets of scenes that are not trained on")
    one.add_argument("--until", type=float, required=True)
    one.set_defaults(run=render_sets)
    two = which.add_parser("train")
    two.add_argument("folder", type=Path)
    two.add_argument("out", type=Path)
    two.add_argument("--nets", nargs="+", default=["epinet-s:32:1"])
    two.add_argument("--until", type=float, required=True)
    two.add_argument("--start", type=Path, help="folder of weights, NAME.npz, to go on from")
    two.add_argument("--rate", type=float, default=1e-3)
    two.add_argument("--crop", type=int, default=64)
    two.add_argument("--capacity", type=int, default=CAPACITY)
    two.add_argument("--every", type=float, default=15)
    two.add_argument("--fine-from", type=float, default=0.6, help="share of the time that bfloat16 will do")
    two.add_argument("--usual", type=float, default=2.2, help="scenes whose |D| stays below come three times")
    two.add_argument("--graph", action="store_true", help="record a step as a CUDA graph")
    two.set_defaults(run=train)
    three = which.add_parser("ship")
    three.add_argument("out", type=Path)
    three.add_argument("name")
    three.add_argument("how", help="commands, machine, seed and commit, in a sentence or two")
    three.add_argument("--scores", default="", help='what benchmarks/accuracy.py found, divided by "; "')
    three.set_defaults(run=ship)
    chosen = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "2")
    chosen.run(chosen)


if __name__ == "__main__":
    main()

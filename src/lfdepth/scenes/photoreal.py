"""Path-traced scenes: shadows, interreflections, gloss and noise of real light transport (Mitsuba 3).

World coordinates are the reference camera's in metres: X to the right, Y down, Z forward. Cameras are
shifted, not rotated: each looks along Z, and its principal point is moved such that all pictures agree at the
focus distance. Truth comes from one ray through each pixel's centre, not from an average over the pixel.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from itertools import pairwise
from math import atan, degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.errors import LightFieldError
from lfdepth.scenes.suite import COLOURS
from lfdepth.scenes.textures import natural

if TYPE_CHECKING:
    from lfdepth.scenes.masks import Labels, Map
    from lfdepth.scenes.rendering import Rendering

Vector = tuple[float, float, float]
Progress = Callable[[int, int, str], None]

FOCUS_M = 8.0
INFINITY = 5.0
"""Disparity, px per view step, that points at infinity have with a minus: it sets the baseline."""
BOUNCES = 5
FINE = 10
"""Rays per pixel, along one axis, among which occlusion boundaries are looked for."""
_NEAR_CLIP = 0.1
_PIECES = 8  # of a wire: the box around a short piece of an oblique one is small, so fewer rays test it
_TRIAL = 64  # px, longer side of the picture that tells how fast this machine is
_TRACES = 4  # of the high-resolution geometry: the truth, its boundaries, and two masks
_RAYS_AT_ONCE = 1 << 22
_THIN, _FLAT, _ROUND = "thin", "slanted", "smooth"


def camera(size: tuple[int, int]) -> Camera:
    """The reference camera; 100 mm lens, 35 mm sensor, focused at 8 m."""
    pitch = 35.0 / max(size)
    baseline = INFINITY * FOCUS_M * 1000 * pitch / 100.0
    return Camera(100.0, 35.0, baseline, FOCUS_M, width=size[1], height=size[0])


@dataclass
class Set:
    """Things put before the camera: Mitsuba's description of them, and the mask that each counts in.

    `pixel` is the side of what a pixel sees at a distance of 1 m, in metres; `folder` is for meshes.
    """

    mi: Any
    rng: np.random.Generator
    pixel: float
    folder: Path
    things: dict[str, dict[str, Any]] = field(default_factory=dict)
    kinds: dict[str, dict[str, Any]] = field(default_factory=dict)

    def add(self, shape: dict[str, Any], material: dict[str, Any], kind: str) -> None:
        """Put a shape of a material; `kind` names the mask that it counts in."""
        name = f"thing{len(self.things)}"
        self.things[name] = {**shape, "bsdf": material}
        self.kinds.setdefault(kind, {})[name] = shape

    def uniform(self, low: float, high: float) -> float:
        """Chance, evenly distributed."""
        return float(self.rng.uniform(low, high))

    def place(self, at: Vector, size: Vector, turn: Sequence[float] = (0, 0, 0)) -> Any:
        """Transform of a unit shape: scaled, turned by degrees about X, Y and Z, moved."""
        transform = self.mi.ScalarTransform4f().translate(list(at))
        for axis, angle in zip(np.eye(3).tolist(), turn, strict=True):
            transform = transform.rotate(axis, angle)
        return transform.scale(list(size))

    def cloth(self, *names: str, across: float = 0.3, n: int = 256, **options: float) -> dict[str, Any]:
        """Mottled colour, as fine as pixels at the focus, for a surface `across` metres wide."""
        repeat = across / (n * self.pixel * FOCUS_M)
        values = natural(self.rng, n, [COLOURS[name] for name in names], **options)
        return {
            "type": "bitmap",
            "bitmap": self.mi.Bitmap(np.rint(values).astype(np.uint8)),
            "to_uv": self.mi.ScalarTransform4f().scale([repeat, repeat, 1]),
        }

    def matt(self, colour: dict[str, Any]) -> dict[str, Any]:
        """Material without gloss, the same from both sides."""
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}

    def glossy(self, colour: dict[str, Any], roughness: float) -> dict[str, Any]:
        """Varnished material."""
        return {"type": "roughplastic", "diffuse_reflectance": colour, "alpha": roughness}

    def metal(self, roughness: float) -> dict[str, Any]:
        """Blank metal."""
        return {"type": "roughconductor", "material": "Al", "alpha": roughness}

    def room(self, floor: dict[str, Any], wall: dict[str, Any], wall_at: float = 11.2) -> None:
        """Floor 1.1 m below the cameras and a slightly turned wall."""
        lying = self.place((0, 1.1, 8.5), (4, 4, 1), (90, 0, 0))
        self.add({"type": "rectangle", "to_world": lying}, floor, _FLAT)
        standing = self.place((0, 0, wall_at), (4, 4, 1), (0, 172, 0))
        self.add({"type": "rectangle", "to_world": standing}, wall, _FLAT)

    def light(self) -> None:
        """Bright sky, and a lamp above and behind the cameras that throws soft shadows."""
        self.things["sky"] = {"type": "constant", "radiance": 0.6}
        transform = self.mi.ScalarTransform4f()
        lamp = transform.look_at(origin=[-2.5, -4.0, 3.0], target=[0, 0.5, 8.5], up=[0, 0, 1]).scale(1.2)
        emitter = {"type": "area", "radiance": {"type": "rgb", "value": [12.0, 11.2, 10.0]}}
        self.things["lamp"] = {"type": "rectangle", "to_world": lamp, "emitter": emitter}


def _boxes(stage: Set) -> None:
    """Two dozen boxes of three cloths, each turned its own way, on the floor and in the air."""
    stage.room(
        stage.matt(stage.cloth("sand", "clay", across=8, n=1024)),
        stage.matt(stage.cloth("ivory", "haze", across=8, n=1024)),
    )
    cloths = [
        stage.matt(stage.cloth(*names)) for names in (("slate", "haze"), ("brick", "sand"), ("olive", "moss"))
    ]
    for i in range(24):
        z, side = 6.5 + 4.0 * i / 23, stage.uniform(0.07, 0.22)
        x, y = stage.uniform(-0.16, 0.16) * z, 1.1 - side if i % 2 else stage.uniform(-0.9, 0.8)
        turn = [0.0, stage.uniform(0, 90), 0.0] if i % 2 else [stage.uniform(0, 90) for _ in range(3)]
        shape = {"type": "cube", "to_world": stage.place((x, y, z), (side, side, side), turn)}
        stage.add(shape, cloths[i % 3], _FLAT)


def _foliage(stage: Set) -> None:
    """Three hundred bent leaves at random places and angles."""
    stage.room(
        stage.matt(stage.cloth("moss", "soot", "olive", across=8, n=1024)),
        stage.matt(stage.cloth("moss", "olive", "slate", across=8, n=1024)),
    )
    greens = [
        stage.matt(stage.cloth(*names, variety=0.7))
        for names in (("moss", "olive"), ("olive", "sand"), ("moss", "soot"), ("olive", "brick"))
    ]
    mesh = stage.folder / "leaf.ply"
    mesh.write_text(_leaf_mesh(), encoding="ascii")
    for i in range(300):
        z, length = 6.5 + 4.2 * i / 299, stage.uniform(0.06, 0.17)
        at = (stage.uniform(-0.18, 0.18) * z, stage.uniform(-0.18, 0.15) * z, z)
        turn = stage.uniform(-50, 50), stage.uniform(-50, 50), stage.uniform(0, 360)
        transform = stage.place(at, (length, length * stage.uniform(0.7, 1.3), length), turn)
        shape = {"type": "ply", "filename": str(mesh), "to_world": transform}
        stage.add(shape, greens[i % 4], _ROUND)


def _leaf_mesh() -> str:
    """PLY of a pointed leaf, 2 long along x and 0.7 wide, bent along its length and folded along its rib."""
    s, t = np.meshgrid(np.linspace(-1, 1, 13), np.linspace(-1, 1, 5))
    y = 0.35 * t * (1.02 - s * s)  # a tip of no width would leave triangles without a normal
    z = 0.25 * s * s - 0.3 * np.abs(y)
    vertices = np.stack([s, y, z, (s + 1) / 2, (t + 1) / 2], axis=-1).reshape(-1, 5)
    corner = np.arange(s.size).reshape(s.shape)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    faces = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))])
    header = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "u", "v")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(f"{value:.6f}" for value in vertex) for vertex in vertices]
    return "\n".join([*header, *rows, *(f"3 {i} {j} {k}" for i, j, k in faces), ""])


def _fence(stage: Set) -> None:
    """A mesh of wires about 2.6 px thick between posts, before boxes."""
    _boxes(stage)
    z, reach, pitch = 6.3, 1.7, 0.26
    radius = 1.3 * stage.pixel * z
    for i in range(-12, 13):
        for side in (-1, 1):
            middle = i * pitch
            ends = [middle - side * reach, -reach, z], [middle + side * reach, reach, z]
            for p0, p1 in pairwise(np.linspace(*ends, _PIECES + 1).tolist()):
                shape = {"type": "cylinder", "p0": p0, "p1": p1, "radius": radius}
                stage.add(shape, stage.metal(0.3), _THIN)
    wood = stage.matt(stage.cloth("clay", "olive", across=1))
    for x in (-0.9, 0.95):
        shape = {"type": "cylinder", "p0": [x, -2, z - 0.06], "p1": [x, 2, z - 0.06], "radius": 0.045}
        stage.add(shape, wood, _ROUND)


def _gloss(stage: Set) -> None:
    """Varnished balls and metal on a polished floor that mirrors them."""
    stage.room(
        stage.glossy(stage.cloth("brick", "clay", "olive", across=8, n=1024), 0.08),
        stage.matt(stage.cloth("sand", "haze", across=8, n=1024)),
    )
    glazes = [
        stage.glossy(stage.cloth(*names, across=1.5), 0.05) for names in (("slate", "haze"), ("moss", "sand"))
    ]
    materials = [*glazes, stage.metal(0.12), stage.glossy(stage.cloth("ivory", across=1.5, contrast=3), 0.15)]
    for i in range(10):
        z, radius = 6.7 + 3.6 * i / 9, stage.uniform(0.15, 0.36)
        x = 0.16 * z * (-1, 1, 0.1, -0.6, 0.6)[i % 5] * stage.uniform(0.6, 1)
        shape = {"type": "sphere", "center": [x, 1.1 - radius, z], "radius": radius}
        stage.add(shape, materials[i % 4], _ROUND)
    leaning = stage.place((0.15, 0.1, 10.0), (0.9, 0.6, 1), (12, 195, 0))
    board = stage.glossy(stage.cloth("haze", "slate", across=1.5), 0.1)
    stage.add({"type": "rectangle", "to_world": leaning}, board, _FLAT)


def _plain(stage: Set, name: str) -> dict[str, Any]:
    """Matt, of one colour: nothing but shading tells its shape."""
    colour = [float(level) for level in (np.array(COLOURS[name]) / 255) ** 2.2]
    return stage.matt({"type": "rgb", "value": colour})


def _balls(stage: Set) -> None:
    """Smooth plastic balls of one colour each before a textured wall."""
    stage.room(
        stage.matt(stage.cloth("sand", "clay", across=8, n=1024)),
        stage.matt(stage.cloth("slate", "haze", across=8, n=1024)),
    )
    for i, colour in enumerate(("brick", "olive", "ivory", "moss", "clay", "haze", "sand", "slate")):
        z, radius = 6.8 + 3.2 * i / 7, stage.uniform(0.22, 0.42)
        x = 0.15 * z * (-1, 1, 0.1, -0.5, 0.6, -0.2, 0.9, -0.9)[i] * stage.uniform(0.7, 1)
        y = 1.1 - radius if i % 2 else stage.uniform(-0.8, 0.5)
        shape = {"type": "sphere", "center": [x, y, z], "radius": radius}
        stage.add(shape, _plain(stage, colour), _ROUND)


def _table(stage: Set) -> None:
    """A plain slanted table with a few textured things on it, before a plain wall."""
    stage.room(_plain(stage, "haze"), _plain(stage, "sand"))
    top = stage.place((0, 0.45, 8.6), (1.3, 2.0, 1), (102, 0, 0))
    stage.add({"type": "rectangle", "to_world": top}, _plain(stage, "ivory"), _FLAT)
    cloths = [stage.matt(stage.cloth(*names)) for names in (("brick", "sand"), ("olive", "moss"))]
    for i in range(6):
        z, side = 7.4 + 2.4 * i / 5, stage.uniform(0.08, 0.16)
        x = 0.13 * z * (-0.9, 0.5, -0.2, 0.9, -0.6, 0.2)[i]
        above = 0.45 - (z - 8.6) * 0.2126  # the tangent of 12 degrees
        turn = [0.0, stage.uniform(0, 90), 0.0]
        shape = {"type": "cube", "to_world": stage.place((x, above - side, z), (side, side, side), turn)}
        stage.add(shape, cloths[i % 2], _FLAT)


@dataclass(frozen=True)
class Motif:
    """How to fill a set, and what it is for."""

    build: Callable[[Set], None]
    description: str


MOTIFS = {
    "photo-boxes": Motif(
        _boxes, "Path-traced: textured boxes turned every way, with shadows; D from -1.5 to 1.3."
    ),
    "photo-foliage": Motif(
        _foliage, "Path-traced: three hundred bent leaves before a wall; D from -1.5 to 1.3."
    ),
    "photo-fence": Motif(_fence, "Path-traced: a thin wire mesh and posts before boxes; D from -1.5 to 1.5."),
    "photo-gloss": Motif(
        _gloss, "Path-traced: varnished balls, metal and a polished floor; D from -1.5 to 1.2."
    ),
    "photo-balls": Motif(
        _balls, "Path-traced: plastic balls of one colour each before a textured wall; D from -1.5 to 1.2."
    ),
    "photo-table": Motif(
        _table,
        "Path-traced: a plain slanted table with a few things on it, a plain wall; D from -1.5 to 1.2.",
    ),
}
"""Path-traced scenes by name."""


def render(
    name: str,
    size: tuple[int, int],
    views: tuple[int, int],
    seed: int,
    noise: float | None,
    samples: int,
    progress: Progress | None = None,
) -> Rendering:
    """Path-trace a scene.

    Parameters
    ----------
    name : str
        One of `MOTIFS`.
    size, views, seed, noise
        As in `lfdepth.scenes.render`; noise comes on top of that of the path tracing.
    samples : int
        A pixel is the mean over (samples + 1)² paths, spread evenly over its area and over the lamp
        (multi-jittered sampling). The noise that is left has a standard deviation of some 4 grey levels at 3
        samples and 2 at 5.
    progress : callable, optional
        Called with (views done, views in all, what comes next).

    Raises
    ------
    LightFieldError
        If Mitsuba is not installed.
    """
    from lfdepth.scenes.rendering import Rendering, assemble, expose

    mi, taken = _mitsuba(), camera(size)
    scene, parts = build(mi, name, taken, seed)
    geometry = _geometry(mi, scene, parts, taken)
    pictures = np.empty((*views, *size, 3), dtype=np.uint8)
    for number, index in enumerate(np.ndindex(*views)):
        if progress:
            progress(number, views[0] * views[1], f"{name}: view {number + 1} of {views[0] * views[1]}")
        position = index[1] - views[1] // 2, index[0] - views[0] // 2
        picture = _encoded(_light(mi, scene, taken, position, samples, seed * 1000 + number))
        pictures[index] = expose(picture, np.float32(noise or 0), [seed, 1, *index])
    return Rendering(assemble(name, pictures, geometry(1), {}, taken), geometry)


def _light(
    mi: Any, scene: Any, taken: Camera, position: tuple[int, int], samples: int, seed: int
) -> npt.NDArray[np.float32]:
    """Light that a view (u, v) takes, linear RGB, (H, W, 3)."""
    paths = (samples + 1) ** 2
    sensor = mi.load_dict(sensor_of(mi, taken, position, paths))
    return np.asarray(mi.render(scene, sensor=sensor, seed=seed, spp=paths), dtype=np.float32)[..., :3]


def expected_seconds(name: str, size: tuple[int, int], views: tuple[int, int], samples: int) -> float:
    """How long rendering a scene into a folder will take on this machine, s, from a small picture of it.

    Raises
    ------
    LightFieldError
        If Mitsuba is not installed.
    """
    mi, share = _mitsuba(), _TRIAL / max(size)
    small = camera((max(1, round(size[0] * share)), max(1, round(size[1] * share))))
    scene, _ = build(mi, name, small, 0)
    start = time.perf_counter()
    _light(mi, scene, small, (0, 0), samples, 0)
    middle = time.perf_counter()
    trace(mi, scene, small, FINE)
    end = time.perf_counter()
    return (views[0] * views[1] * (middle - start) + _TRACES * (end - middle)) / share**2


def build(mi: Any, name: str, taken: Camera, seed: int) -> tuple[Any, dict[str, Any]]:
    """Mitsuba's scene, and for each mask a scene of only those things that count in it."""
    with tempfile.TemporaryDirectory() as folder:
        pixel = taken.pixel_pitch_mm / taken.focal_length_mm
        stage = Set(mi, np.random.default_rng([seed, 2]), pixel, Path(folder))
        MOTIFS[name].build(stage)
        stage.light()
        integrator = {"type": "path", "max_depth": BOUNCES}
        scene = mi.load_dict({"type": "scene", "integrator": integrator, **stage.things})
        return scene, {
            kind: mi.load_dict({"type": "scene", **things}) for kind, things in stage.kinds.items()
        }


def _geometry(
    mi: Any, scene: Any, parts: Mapping[str, Any], taken: Camera
) -> Callable[[int], tuple[Map, dict[str, Labels]]]:
    """Truth and masks by resolution, as `Rendering.geometry` has them."""
    from lfdepth.scenes.masks import REACH, dilate, jumps, with_benchmark

    @cache
    def fine_boundary() -> npt.NDArray[np.bool_]:
        fine = _disparity(taken, trace(mi, scene, taken, FINE))
        return np.asarray(dilate(jumps(fine), REACH * FINE))

    def geometry(factor: int) -> tuple[Map, dict[str, Labels]]:
        depth = trace(mi, scene, taken, factor)
        step = FINE // factor
        boundary = fine_boundary()[(step - 1) // 2 :: step, (step - 1) // 2 :: step]
        # where the nearest thing is one of a part, the same ray meets it there at the same depth
        masks = {kind: trace(mi, part, taken, factor) == depth for kind, part in parts.items()}
        masks["occlusion_boundary"] = np.ascontiguousarray(boundary)
        labels = {name: mask.view(np.uint8) for name, mask in masks.items() if mask.any()}
        return _disparity(taken, depth), with_benchmark(labels, factor)

    return geometry


def _disparity(taken: Camera, depth: npt.NDArray[np.float64]) -> Map:
    return taken.depth_to_disparity(depth).astype(np.float32)


def _mitsuba() -> Any:
    try:
        mi = import_module("mitsuba")
    except ImportError:
        raise LightFieldError(
            "mitsuba: not installed; expected it for path-traced scenes; run pip install 'lfdepth[render]'"
        ) from None
    # This variant needs no GPU, and no LLVM, whose versions of many systems end the process with an error.
    mi.set_variant("scalar_rgb")
    return mi


def sensor_of(
    mi: Any,
    taken: Camera,
    position: tuple[int, int],
    samples: int,
    factor: int = 1,
    rows: tuple[int, int] | None = None,
) -> dict[str, Any]:
    """Mitsuba's description of the camera of view (u, v), its picture enlarged by `factor`.

    Without `rows` every pixel takes `samples` points spread over its area. With `rows` only these rows are
    rendered, and every pixel takes its centre.
    """
    u, v = position
    baseline = taken.baseline_mm / 1000
    x, y = u * baseline, v * baseline
    # Shift of the principal point, px: b·f / (p·F) per view step, to the side to which the camera moves.
    shift = taken.baseline_mm * taken.focal_length_mm / taken.pixel_pitch_mm / (1000 * taken.focus_distance_m)
    width, height = taken.width * factor, taken.height * factor
    film = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "box"},  # a sensor's pixel counts the light on its own area
        "component_format": "float32",
    }
    sampler: dict[str, Any] = {"type": "multijitter", "sample_count": samples}
    if rows:
        film |= {
            "crop_offset_x": 0,
            "crop_offset_y": rows[0],
            "crop_width": width,
            "crop_height": rows[1] - rows[0],
        }
        sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
    return {
        "type": "perspective",
        "fov": degrees(2 * atan(taken.sensor_size_mm / 2 / taken.focal_length_mm)),
        "fov_axis": "larger",
        "near_clip": _NEAR_CLIP,
        "far_clip": 1000.0,
        # Mitsuba counts the shift the other way, as a share of the picture
        "principal_point_offset_x": -u * shift / taken.width,
        "principal_point_offset_y": -v * shift / taken.height,
        "to_world": mi.ScalarTransform4f().look_at(origin=[x, y, 0], target=[x, y, 1], up=[0, -1, 0]),
        "film": film,
        "sampler": sampler,
    }


def trace(mi: Any, scene: Any, taken: Camera, factor: int = 1) -> npt.NDArray[np.float64]:
    """Depth along the optical axis, metres, at every pixel's centre, (H·factor, W·factor)."""
    height, width = taken.height * factor, taken.width * factor
    depth = np.empty((height, width))
    integrator = mi.load_dict({"type": "depth"})
    pixel = taken.pixel_pitch_mm / taken.focal_length_mm / factor
    x, y = ((np.arange(n) - (n - 1) / 2) * pixel for n in (width, height))
    step = max(1, _RAYS_AT_ONCE // width)
    for start in range(0, height, step):
        rows = start, min(start + step, height)
        sensor = mi.load_dict(sensor_of(mi, taken, (0, 0), 1, factor, rows))
        along = np.asarray(mi.render(scene, sensor=sensor, integrator=integrator, spp=1))[..., 0]
        slant = np.sqrt(1 + x**2 + y[slice(*rows), None] ** 2)
        depth[slice(*rows)] = _NEAR_CLIP + along / slant  # rays start at the near clipping plane
    return depth


def _encoded(light: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Grey levels, 0 to 255, of linear light: sRGB (IEC 61966-2-1)."""
    linear = np.clip(light, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.asarray(255 * encoded, dtype=np.float32)

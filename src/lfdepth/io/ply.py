"""Coloured points and meshes of the visible surface, as binary PLY."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lfdepth.camera import Camera
from lfdepth.io.atomic import atomic
from lfdepth.io.record import Record
from lfdepth.lightfield import LightField

_TYPES = {"<f4": "float", "|u1": "uchar"}
_VERTEX = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]


def write_ply(path: Path, record: Record, scene: LightField, camera: Camera, *, mesh: bool = False) -> None:
    """Write a point for each pixel of the reference view, or triangles between them.

    Vertices have x to the right, y down, z forward from the reference view, in metres, the colour of the
    view, and the confidence if it is known. Pixels infinitely far away are left out.

    Parameters
    ----------
    path : Path
        The file.
    record : Record
        Disparity.
    scene : LightField
        Colours, and the grid that decides where the mesh is cut.
    camera : Camera
        Geometry.
    mesh : bool
        Also write triangles, cut at occlusion boundaries; see `triangles`.
    """
    points = camera.points(record.values)
    valid = np.isfinite(points[..., 2])
    vertices = _vertices(points, scene, record)[valid]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property {_TYPES[vertices.dtype[name].str]} {name}" for name in vertices.dtype.names or ()]
    parts = [vertices]
    if mesh:
        faces = triangles(record.values, valid, occlusion_step(scene))
        table = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", (3,))])
        table["count"], table["corners"] = 3, faces
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        parts.append(table)
    with atomic(path) as temporary, temporary.open("wb") as file:
        file.write("\n".join([*header, "end_header", ""]).encode("ascii"))
        for part in parts:
            file.write(part.tobytes())


def occlusion_step(scene: LightField) -> float:
    """Smallest difference in disparity between neighbouring pixels that is an occlusion boundary, px.

    Pixels one apart in the reference view, with disparities that differ by d, are ``1 - d·u`` apart in view
    u: from ``d = 1 / u`` on one hides the other in the outermost view.
    """
    return 1 / max(scene.centre)


def triangles(
    disparity: npt.NDArray[np.float32], valid: npt.NDArray[np.bool_], step: float
) -> npt.NDArray[np.int32]:
    """Two triangles in each square of four pixels, except across occlusion boundaries.

    Parameters
    ----------
    disparity : ndarray, shape (H, W)
        Disparity, px per view step.
    valid : ndarray, shape (H, W)
        Pixels that are vertices; they are numbered row by row.
    step : float
        Triangles whose disparities span as much or more are left out.

    Returns
    -------
    ndarray, shape (N, 3)
        Vertex numbers; seen from the camera, counter-clockwise.
    """
    pixel = np.arange(disparity.size).reshape(disparity.shape)
    top_left, top_right = pixel[:-1, :-1].ravel(), pixel[:-1, 1:].ravel()
    bottom_left, bottom_right = pixel[1:, :-1].ravel(), pixel[1:, 1:].ravel()
    upper = np.stack([top_left, bottom_left, top_right], axis=1)
    lower = np.stack([top_right, bottom_left, bottom_right], axis=1)
    corners = np.concatenate([upper, lower])
    whole = valid.ravel()[corners].all(axis=1) & (np.ptp(disparity.ravel()[corners], axis=1) < step)
    number = np.cumsum(valid.ravel(), dtype=np.int32) - 1
    faces: npt.NDArray[np.int32] = number[corners[whole]]
    return faces


def _vertices(points: npt.NDArray[Any], scene: LightField, record: Record) -> npt.NDArray[Any]:
    known = [] if record.confidence is None else [("confidence", "<f4")]
    vertices = np.empty(points.shape[:2], dtype=_VERTEX + known)
    for axis, name in enumerate("xyz"):
        vertices[name] = points[..., axis]
    colours = np.rint(scene.reference.astype(np.float32) * (255 / scene.full_scale)).astype(np.uint8)
    for channel, name in enumerate(("red", "green", "blue")):
        vertices[name] = colours[..., channel % scene.shape[4]]
    if record.confidence is not None:
        vertices["confidence"] = record.confidence
    return vertices

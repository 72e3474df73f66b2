"""What a disparity map is good for: refocusing, a picture in focus everywhere, seeing through an occluder.

A point that the reference view shows at (x, y) with disparity D is at (x − D·u, y − D·v) in view (u, v).
Averaging all views there focuses on D, as a lens as wide as the grid of cameras would.
"""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lfdepth.blocks.focusing import average, present_views
from lfdepth.engines import single, using
from lfdepth.engines.layout import SURFACE_JUMP
from lfdepth.errors import LightFieldError
from lfdepth.io.atomic import atomic_folder
from lfdepth.io.names import view_name
from lfdepth.io.pixels import encode_png
from lfdepth.io.record import check_size, checked_map
from lfdepth.lightfield import LightField

if TYPE_CHECKING:
    from lfdepth.result import Result


def refocus(
    lf: LightField,
    disparity: float,
    *,
    without_foreground: float | None = None,
    disparity_map: Result | NDArray[Any] | None = None,
    threads: int | None = None,
) -> NDArray[Any]:
    """Focus on a plane: shift all views so that it is aligned in them, and average them.

    Parameters
    ----------
    lf
        Light field.
    disparity
        Plane, px per view step.
    without_foreground
        Remove everything nearer than this disparity: each pixel is the mean of the views in which no such
        occluder covers it, or of all views if it is covered in all of them.
    disparity_map
        (H, W) disparity of the reference view, or the result of `estimate`: where the foreground is.
    threads
        Number of threads; None uses all processors. The result does not depend on it.

    Returns
    -------
    (H, W, C) array of the views' type; near the border the mean of the views that reach there.

    Raises
    ------
    LightFieldError
        If a disparity is not finite or so large that no other view overlaps the reference view, if the plane
        itself would be removed, or if the map is missing, not finite, or of another size than the views.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("fence", size=64, views=5)
    >>> lfdepth.refocus(lf, -1.0).shape
    (64, 64, 3)
    >>> through = lfdepth.refocus(lf, -1.0, without_foreground=0.5, disparity_map=lf.truth)
    """
    check_reach(lf, disparity, "disparity")
    plane = np.full((lf.height, lf.width), disparity, np.float32)
    picture, _ = _average(lf, plane, threads)
    if without_foreground is not None:
        _check_finite(without_foreground, "without_foreground")
        if disparity > without_foreground:
            raise LightFieldError(
                f"without_foreground: found {without_foreground:g}, expected at least the focused plane's "
                f"{disparity:g} px per view step; raise it or focus farther away"
            )
        if disparity_map is None:
            raise LightFieldError(
                "disparity_map: found none, expected one to locate the foreground; estimate one and pass it"
            )
        limit = np.full_like(plane, without_foreground)
        behind, seen = _average(lf, plane, threads, _checked_map(disparity_map, lf), limit)
        picture = np.where(seen[..., None] > 0, behind, picture)
    return _as_samples(picture, lf)


def all_in_focus(
    lf: LightField, disparity_map: Result | NDArray[Any], *, threads: int | None = None
) -> NDArray[Any]:
    """Focus every pixel at its own disparity.

    The result is the reference view with the noise of all views averaged out. Views in which something nearer
    hides a pixel do not count.

    Parameters
    ----------
    lf
        Light field.
    disparity_map
        (H, W) disparity of the reference view, or the result of `estimate`.
    threads
        Number of threads; None uses all processors. The result does not depend on it.

    Returns
    -------
    (H, W, C) array of the views' type.

    Raises
    ------
    LightFieldError
        If the map is not finite, or of another size than the views.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("bars", size=64, views=5)
    >>> lfdepth.all_in_focus(lf, lf.truth).shape
    (64, 64, 3)
    """
    surface = _checked_map(disparity_map, lf)
    picture, seen = _average(lf, surface, threads, surface, surface + np.float32(SURFACE_JUMP))
    return _as_samples(np.where(seen[..., None] > 0, picture, lf.reference), lf)


def foreground_masks(
    lf: LightField,
    disparity_map: Result | NDArray[Any],
    disparity: float,
    *,
    at: float | None = None,
) -> NDArray[np.bool_]:
    """The 4-D foreground mask: where each view shows something nearer than a disparity.

    Every pixel of the reference view is moved to every view by its own disparity, so that the mask follows
    slanted and staggered foreground exactly; the paper's mask (eq. 7) moves all of it as one plane. What the
    reference view does not see is unknown and counts as background: foreground hidden behind nearer
    foreground, or outside its frame.

    Parameters
    ----------
    lf
        Light field.
    disparity_map
        (H, W) disparity of the reference view, or the result of `estimate`.
    disparity
        Everything above it is foreground, px per view step.
    at
        Plane at which to align the masks, as `lfdepth.blocks.reparam.reparameterise` does with views; by
        default each mask has the coordinates of its own view, which is the plane at 0.

    Returns
    -------
    (V, U, H, W) bool; False for absent views.

    Raises
    ------
    LightFieldError
        If a disparity is not finite, `at` shifts all views out of the frame, or the map is not finite or of
        another size than the views.

    Examples
    --------
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("fence", size=64, views=5)
    >>> masks = lfdepth.foreground_masks(lf, lf.truth, 0.5)
    >>> masks.shape, bool((masks[2, 2] == (lf.truth > 0.5)).all())
    ((5, 5, 64, 64), True)
    """
    _check_finite(disparity, "disparity")
    check_reach(lf, 0.0 if at is None else at, "at")
    surface = _checked_map(disparity_map, lf)
    masks = np.zeros(lf.shape[:4], np.bool_)
    for index, v, u in present_views(lf):
        masks[index] = single().seen(surface, (v, u), plane=at or 0.0) > disparity
    return masks


def write_masks(folder: str | Path, masks: NDArray[np.bool_], lf: LightField) -> None:
    """Write a mask per view as `mask_v03_u05.png`, white = foreground; all of them or nothing.

    Parameters
    ----------
    folder
        Folder to create, in an existing one. An empty folder, or earlier masks, are replaced.
    masks
        (V, U, H, W) bool.
    lf
        Light field of the masks: nothing is written for views that are absent.

    Raises
    ------
    LightFieldError
        If the masks do not have the light field's shape, or the folder cannot be written or holds something
        else.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import lfdepth
    >>> from lfdepth import scenes
    >>> lf = scenes.render("fence", size=64, views=5)
    >>> folder = Path(tempfile.mkdtemp()) / "masks"
    >>> lfdepth.write_masks(folder, lfdepth.foreground_masks(lf, lf.truth, 0.5), lf)
    >>> len(list(folder.glob("*.png")))
    25
    """
    if masks.shape != lf.shape[:4]:
        raise LightFieldError(
            f"{folder}: masks have shape {masks.shape}; expected {lf.shape[:4]}, a mask for each view of "
            f"{lf.name}; give both together"
        )
    with atomic_folder(folder) as temporary:
        for (row, column), _, _ in present_views(lf):
            file = temporary / view_name("mask", (row, column), lf.shape[:2], "png")
            file.write_bytes(encode_png(masks[row, column]))


def _average(
    lf: LightField,
    focus: NDArray[np.float32],
    threads: int | None,
    surface: NDArray[np.float32] | None = None,
    limit: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """`blocks.focusing.average` on the default engine."""
    with using(None, threads=threads) as engine:
        return average(lf, focus, engine, surface=surface, limit=limit)


def _as_samples(picture: NDArray[np.float32], lf: LightField) -> NDArray[Any]:
    """Mean values as samples of the views' type."""
    if lf.views.dtype == np.float32:
        return np.asarray(np.clip(picture, 0, 1), np.float32)
    return np.rint(picture).astype(lf.views.dtype)


def _checked_map(disparity_map: Result | NDArray[Any], lf: LightField) -> NDArray[np.float32]:
    values = disparity_map if isinstance(disparity_map, np.ndarray) else disparity_map.disparity
    values = checked_map(values, "disparity_map")
    check_size(values, lf, "disparity_map")
    return np.ascontiguousarray(values)


def check_reach(lf: LightField, disparity: float, what: str) -> None:
    """Raise LightFieldError unless some view beside the reference view overlaps it on a plane."""
    _check_finite(disparity, what)
    others = [(v, u) for _, v, u in present_views(lf) if (v, u) != (0, 0)]
    if others and not any(
        abs(disparity * v) < lf.height and abs(disparity * u) < lf.width for v, u in others
    ):
        most = max(lf.height if lf.shape[0] > 1 else 0, lf.width if lf.shape[1] > 1 else 0)
        raise LightFieldError(
            f"{what}: found {disparity:g} px per view step, which shifts every other view out of the "
            f"picture; expected less than {most} px either way; see lfdepth info for the scene's range"
        )


def _check_finite(value: float, what: str) -> None:
    if not isfinite(value):
        raise LightFieldError(f"{what}: found {value}, expected a finite number of px per view step")

"""Control values of textures with the look of natural surfaces: (n, n, 3) float32, periodic, 20..235.

Each is meant for `Paint.texture`. Spectra fall like those of natural images (amplitude near 1/f, Field 1987,
doi:10.1364/JOSAA.4.002379) between a longest and a shortest wavelength, and contrast varies over the surface,
down to areas of one or two grey levels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float64]
Colour = Sequence[float]

DARKEST, BRIGHTEST = 20.0, 235.0


def noise(rng: np.random.Generator, n: int, slope: float, shortest: float, longest: float) -> Float:
    """Periodic Gaussian noise (n, n) of mean 0 and deviation 1, amplitude ~ f^-slope, wavelengths in px."""
    fy, fx = np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)
    f = np.hypot(fx, fy)
    f[0, 0] = 1.0
    amplitude = f**-slope * np.exp(-((f * shortest) ** 4)) * -np.expm1(-((f * longest) ** 2))
    amplitude[0, 0] = 0.0
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((n, n))) * amplitude, s=(n, n))
    return np.asarray(field / field.std())


def natural(
    rng: np.random.Generator,
    n: int,
    colours: Sequence[Colour],
    contrast: float = 12.0,
    shortest: float = 2.5,
    patch: float = 60.0,
    weak: float = 0.35,
    variety: float = 0.45,
) -> npt.NDArray[np.float32]:
    """Mottled surface: patches of colours, 1/f detail on them, fading out over part of the surface.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of chance.
    n : int
        Size, a power of two.
    colours : sequence of RGB
        One or more: the surface's own, then those that its patches lean to; soft edges about 2 px wide.
    contrast : float
        Deviation of the detail, grey levels, where it is strong.
    shortest : float
        Shortest wavelength of the detail, px.
    patch : float
        Typical size of the patches, px.
    weak : float
        Share of the surface, roughly, on which the detail fades to a twentieth.
    variety : float
        How far patches go from the surface's own colour to theirs, 0 to 1.
    """
    own = np.asarray(colours[0], dtype=np.float64)
    base = own + variety * (_patches(rng, n, colours, patch) - own)
    fading = noise(rng, n, 1.0, patch / 3, 3 * patch)
    strength = 0.05 + 0.95 / (1 + np.exp(-4 * (fading - np.quantile(fading, weak))))
    luma = noise(rng, n, 1.0, shortest, 80.0)
    chroma = np.stack([noise(rng, n, 1.0, 2 * shortest, 80.0) for _ in range(3)], axis=-1)
    detail = luma[..., None] * [1.0, 0.96, 0.9] + 0.25 * chroma
    return _limited(base + contrast * strength[..., None] * detail)


def plain(
    rng: np.random.Generator, n: int, colour: Colour, swing: float = 6.0, grain: float = 0.4
) -> npt.NDArray[np.float32]:
    """Painted wall: one colour, slow shading of deviation `swing`, grain of deviation `grain` grey levels."""
    shading = noise(rng, n, 1.0, n / 3, 2.0 * n)
    speckle = noise(rng, n, 0.5, 3.0, 20.0)
    return _limited(np.asarray(colour) + (swing * shading + grain * speckle)[..., None])


def striped(
    rng: np.random.Generator, n: int, colours: Sequence[Colour], bands: int, contrast: float = 8.0
) -> npt.NDArray[np.float32]:
    """Planks along x: `bands` of them over the period, each in one of the colours; grain and dark seams."""
    y = np.arange(n) * bands / n
    band = np.asarray(colours, dtype=np.float64)[rng.integers(len(colours), size=bands)]
    band = band * rng.uniform(0.85, 1.1, size=(bands, 1))
    seam = np.exp(-((np.minimum(y % 1, 1 - y % 1) * n / bands / 1.5) ** 2))
    base = band[np.floor(y).astype(int)] * (1 - 0.5 * seam[:, None])
    grain = np.repeat(noise(rng, n, 1.0, 2.5, 60.0)[:, :: max(1, n // 64)], max(1, n // 64), axis=1)
    detail = 0.5 * noise(rng, n, 1.0, 2.5, 60.0) + 0.7 * _smooth_rows(grain)
    return _limited(base[:, None, :] + contrast * detail[..., None])


def _patches(rng: np.random.Generator, n: int, colours: Sequence[Colour], size: float) -> Float:
    """Soft-edged patches of colours, each equally common."""
    base = np.broadcast_to(np.asarray(colours[0], dtype=np.float64), (n, n, 3)).copy()
    for i, colour in enumerate(colours[1:], start=2):
        field = noise(rng, n, 1.2, size / 6, 2 * size)
        slope = np.hypot(*np.gradient(field)).mean()
        share = 1 / (1 + np.exp(-(field - np.quantile(field, 1 - 1 / i)) / (0.5 * slope)))
        base += share[..., None] * (np.asarray(colour) - base)
    return base


def _smooth_rows(field: Float) -> Float:
    """Low-pass along x, so that a stretched field has no steps."""
    n = field.shape[1]
    spectrum = np.fft.rfft(field, axis=1) * np.exp(-((np.fft.rfftfreq(n) * 16) ** 2))
    return np.asarray(np.fft.irfft(spectrum, n=n, axis=1))


def _limited(values: Float) -> npt.NDArray[np.float32]:
    """Keep the sensible range; the spline stays within its control values."""
    return np.clip(values, DARKEST, BRIGHTEST).astype(np.float32)

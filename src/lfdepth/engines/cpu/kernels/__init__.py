"""Kernels: functions over rows of an image, compiled by numba; only the engine calls them."""

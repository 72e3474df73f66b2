"""The CPU engine: kernels compiled by numba, run over bands of rows by a pool of threads."""

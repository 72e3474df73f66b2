"""The experiments and figures of the paper."""

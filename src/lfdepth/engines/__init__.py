"""Engines: what blocks call to have the work done."""

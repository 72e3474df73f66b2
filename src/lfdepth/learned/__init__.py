"""Learned systems: what they are made of, their weights, and how they run without a framework."""

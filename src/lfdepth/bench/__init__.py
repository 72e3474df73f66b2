"""Comparisons: methods over scenes, tables, reports, submissions."""

"""Captures with a hidden effect, the search run on them, and its score: `python -m benchmarks.gap`."""

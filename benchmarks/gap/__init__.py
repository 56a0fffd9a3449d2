"""Captures with a hidden effect, the search run on them, and its score: `physreal gap-benchmark`."""

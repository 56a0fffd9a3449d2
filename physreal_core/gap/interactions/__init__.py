"""Interactions with one object: each rolls out a model with trial effects and holds the measurement beside it."""

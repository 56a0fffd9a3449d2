"""Interactions with one object: each rolls out a model with trial effects and has its measurement beside it."""

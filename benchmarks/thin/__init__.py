"""Shells and rods beside closed forms and recordings; each module is a command that adds its numbers to `results/thin.json`."""

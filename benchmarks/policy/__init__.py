"""A small policy, trained on the episodes of a twin, lifts the body of another simulator."""

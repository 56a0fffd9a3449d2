"""find_gap and add_effect on the artifacts of the tiny scene: report written and read, the effect in the model and after it."""

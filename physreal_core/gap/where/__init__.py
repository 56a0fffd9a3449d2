"""Where a simulation and its measurement disagree: frames, part of the body, kind of departure, significance."""

"""The stages: `python -m stages.<name> <sequence>`."""

from pipeline.threads import limit_threads

limit_threads()

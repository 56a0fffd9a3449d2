"""`python -m benchmarks.gap`."""

from benchmarks.gap.command import main

if __name__ == "__main__":
    main()

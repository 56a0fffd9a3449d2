"""`python -m benchmarks.gap`: the same as `physreal gap-benchmark`."""

import argparse
import sys

from benchmarks.gap.command import add_arguments

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="physreal gap-benchmark")
    add_arguments(parser)
    parsed = parser.parse_args()
    sys.exit(parsed.command(parsed))

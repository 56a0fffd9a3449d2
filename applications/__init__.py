"""What a fitted twin is for: each command that uses one, in a package of its own."""

"""What surrounds the object: air, and gravity that is not what was assumed."""

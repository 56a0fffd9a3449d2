"""What the object touches."""

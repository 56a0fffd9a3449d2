"""How the hand holds the object, and how well its record fits."""

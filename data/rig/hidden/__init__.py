"""What a capture's description does not tell: one class per hidden effect, coded from its physics, without `physreal_core`."""

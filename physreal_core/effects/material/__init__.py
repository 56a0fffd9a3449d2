"""What the object's material does beyond elasticity, and where its elasticity differs."""

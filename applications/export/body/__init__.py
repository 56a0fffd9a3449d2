"""The twin as another simulator needs it: nodes with masses and elements, means of the material, the hand as one rigid body."""

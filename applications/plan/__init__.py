"""`physreal plan`: where the hand has to go so that a fitted twin comes to be where it is wanted."""

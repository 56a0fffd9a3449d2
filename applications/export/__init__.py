"""`physreal export`: the twin's motion in the formats of other tools, and its model for another simulator."""

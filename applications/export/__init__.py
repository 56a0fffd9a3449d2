"""`physreal export`: the twin's motion in the formats of other tools."""

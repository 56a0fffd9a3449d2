"""`physreal live`: the twin follows a stream of measurements."""

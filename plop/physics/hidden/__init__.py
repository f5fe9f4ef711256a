"""Effects that a simulation hides: as given, drawn at random, scaled to a signal."""

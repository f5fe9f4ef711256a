"""What a law would change: hypotheses, the engine runs that answer them, and the table of all answers."""

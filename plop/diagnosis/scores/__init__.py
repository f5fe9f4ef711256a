"""How well each hypothesis explains the evidence, and how often chance explains as much."""

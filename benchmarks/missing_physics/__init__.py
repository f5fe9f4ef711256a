"""Hidden effects and faults, and what `plop diagnose` names."""

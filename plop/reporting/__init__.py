"""Pictures and pages that show people where a prediction fails, and why."""

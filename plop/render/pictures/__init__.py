"""Pictures and videos for display."""
